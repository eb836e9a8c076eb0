"""Real inertias by pendulum beside the published values.

Real bicycles (moorepants/BicycleParameters): frame B, fork with handlebar H (or handlebar G and fork S apart), wheels F
and R; the frame of the published values has x forward, z down, its origin under the rear wheel. Standard errors of
everything measured are propagated; published ± are one standard deviation.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impedance.body.pendulum import (
    centre_of_lines,
    compound_inertia,
    period_of,
    planar_tensor,
    rod_inertia,
    torsional_inertia,
)
from impedance.identification.propagation import propagated
from messages.arrays import FloatArray

Centre = Callable[[FloatArray, FloatArray], FloatArray]

BICYCLES = ("Browser", "Browserins", "Balanceassistv1", "Rigid")
_LINE = re.compile(r"^(\w+)\s*=\s*(.+)$")


@dataclass(frozen=True)
class Row:
    """One published quantity: ours and theirs, each with its standard deviation."""

    name: str
    ours: float
    our_deviation: float
    published: float
    published_deviation: float

    @property
    def off(self) -> float:
        """Return the difference in published standard deviations."""
        return (self.ours - self.published) / self.published_deviation


def read_values(path: Path) -> dict[str, list[tuple[float, float]]]:
    """Return every quantity's readings, each with its standard deviation, of a `…Measured.txt` or `…Benchmark.txt`."""
    values = {}
    for line in path.read_text().splitlines():
        found = _LINE.match(line.strip())
        if found:
            readings = [each.strip().split("+/-") for each in found[2].split(",")]
            values[found[1]] = [(float(r[0]), float(r[1]) if len(r) > 1 else 0.0) for r in readings]
    return values


def compared(folder: Path, name: str, centre: Centre = centre_of_lines) -> list[Row]:
    """Return the inertial parameters of one bicycle beside the published ones; `centre` evaluates the lines."""
    readings = read_values(folder / f"{name}Measured.txt")
    keys = list(readings)
    mean = np.array([np.mean([value for value, _ in readings[key]]) for key in keys])
    deviation = np.array([np.sqrt(sum(d * d for _, d in readings[key])) / len(readings[key]) for key in keys])
    names = list(inertial_parameters(dict(zip(keys, mean.tolist(), strict=True)), centre))

    def evaluated(x: FloatArray) -> FloatArray:
        return np.array([*inertial_parameters(dict(zip(keys, x.tolist(), strict=True)), centre).values()])

    ours = propagated(evaluated, mean, deviation)
    published = read_values(folder / f"{name}Benchmark.txt")
    return [
        Row(each, value, own, *published[each][0])
        for each, value, own in zip(names, ours.value.tolist(), ours.deviation.tolist(), strict=True)
        if each in published
    ]


def inertial_parameters(mp: dict[str, float], centre: Centre) -> dict[str, float]:
    """Return centres of mass and inertias by the published names."""
    geometry = _geometry(mp)
    lam, w, r_f, r_r = geometry["lam"], geometry["w"], geometry["rF"], geometry["rR"]
    rod = rod_inertia(mp["mP"], mp["lP"], 0.5 * mp["dP"])
    result = {}
    for wheel in "FR":
        result[f"I{wheel}xx"] = float(torsional_inertia(np.array([mp[f"Tt{wheel}1"]]), mp["TtP1"], rod)[0])
        result[f"I{wheel}yy"] = compound_inertia(mp[f"Tc{wheel}1"], mp[f"m{wheel}"], mp[f"l{wheel}"], mp["g"])
    references = {"B": (0.0, -r_r), "H": (w, -r_f), "S": (w, -r_f), "G": (0.0, 0.0)}
    if "h6" in mp:
        references["G"] = _handlebar(mp, geometry)
    for part, reference in references.items():
        if f"alpha{part}1" not in mp:
            continue
        turns = [key for key in mp if re.fullmatch(rf"alpha{part}\d", key)]
        beta = lam - np.deg2rad(np.array([mp[key] for key in turns]))
        x, z = centre(beta, np.array([mp[f"a{key[5:]}"] for key in turns])).tolist()
        periods = np.array([mp[f"Tt{key[5:]}"] for key in turns])
        xx, xz, zz = planar_tensor(beta, torsional_inertia(periods, mp["TtP1"], rod)).tolist()
        yy = compound_inertia(mp[f"Tc{part}1"], mp[f"m{part}"], float(np.hypot(x, z)), mp["g"])
        result |= {f"x{part}": reference[0] + x, f"z{part}": reference[1] + z}
        result |= {f"I{part}xx": xx, f"I{part}xz": xz, f"I{part}yy": yy, f"I{part}zz": zz}
    if "mH" not in mp:
        result |= _joined(mp, result)
    return result


def raw_period(folder: Path) -> tuple[float, float]:
    """Return the period of the fork's compound swing from the raw rate gyro, s, and its deviation."""
    with np.load(folder / "BrowserInsForkCompoundFirst1_rate_gyro.npz") as data:
        return period_of(data["signal_volts"].astype(np.float64), float(data["sample_rate_hz"]))


def _geometry(mp: dict[str, float]) -> dict[str, float]:
    """Return wheel radii, steer axis tilt and wheelbase: the tilt measured, or from heights over a table."""
    r_f, r_r = (mp[f"d{wheel}"] / (2.0 * np.pi * mp[f"n{wheel}"]) for wheel in "FR")
    if "w" in mp:
        return {"rF": r_f, "rR": r_r, "lam": np.deg2rad(90.0 - mp["gamma"]), "w": mp["w"]}
    a = mp["h1"] + mp["h2"] - mp["h3"] + 0.5 * (mp["d1"] - mp["d2"])
    b = mp["h4"] - 0.5 * mp["d3"] - mp["h5"] + 0.5 * mp["d4"]
    c = np.sqrt((mp["d"] + 0.5 * (mp["d2"] + mp["d3"])) ** 2 - (a - b) ** 2)
    lam = np.arctan2(c, a + b) + np.arcsin((r_f - r_r) / np.hypot(a + b, c))
    return {"rF": r_f, "rR": r_r, "lam": float(lam), "w": float((a + b) * np.cos(lam) + c * np.sin(lam))}


def _handlebar(mp: dict[str, float], geometry: dict[str, float]) -> tuple[float, float]:
    """Return where the handlebar's reference point lies when the fork is split."""
    across = mp["h7"] - mp["h6"] + 0.5 * (mp["d5"] - mp["d6"])
    along = np.sqrt((mp["l"] - 0.5 * (mp["d5"] + mp["d6"])) ** 2 - across**2)
    sin, cos = np.sin(geometry["lam"]), np.cos(geometry["lam"])
    return geometry["w"] - along * sin + across * cos, -geometry["rF"] - along * cos - across * sin


def _joined(mp: dict[str, float], parts: dict[str, float]) -> dict[str, float]:
    """Return H of G and S, by the parallel axes."""
    mass = mp["mG"] + mp["mS"]
    x, z = ((mp["mG"] * parts[f"{axis}G"] + mp["mS"] * parts[f"{axis}S"]) / mass for axis in "xz")
    joined = {"xH": x, "zH": z, "IHxx": 0.0, "IHxz": 0.0, "IHyy": 0.0, "IHzz": 0.0}
    for part in "GS":
        m, dx, dz = mp[f"m{part}"], parts[f"x{part}"] - x, parts[f"z{part}"] - z
        joined["IHxx"] += parts[f"I{part}xx"] + m * dz * dz
        joined["IHxz"] += parts[f"I{part}xz"] - m * dx * dz
        joined["IHyy"] += parts[f"I{part}yy"] + m * (dx * dx + dz * dz)
        joined["IHzz"] += parts[f"I{part}zz"] + m * dx * dx
    return joined
