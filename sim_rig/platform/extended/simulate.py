"""The extended model in MuJoCo: the rig with effects of known size in its mechanics and instruments."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import permutations
from math import inf
from typing import Final

import numpy as np

from impedance.body.rigid_body import Inertia
from impedance.recording.recording import PlatformRecording, Truth
from messages.arrays import FloatArray
from messages.errors import UserError, unknown_name
from sim_rig.platform.extended.flaws import CHANNELS, Fields, combined
from sim_rig.platform.extended.laboratory import Laboratory
from sim_rig.platform.extended.plate_noise import PlateNoise
from sim_rig.platform.extended.unit import PlatformUnit, stepped
from sim_rig.platform.rig import FOOT, PLATE, Rig
from sim_rig.platform.run import SPAN_NM

Entries = Mapping[str, tuple[float, str]]
"""Values with their units, by name."""
Named = Mapping[str, float]

_BODY: Final = {
    "mass_kg": "kg",
    **{f"m{axis}_kgm": "kg·m" for axis in "xyz"},
    **{f"j{axes}_kgm2": "kg·m²" for axes in ("xx", "yy", "zz", "yz", "xz", "xy")},
}
_OF: Final = dict(zip(CHANNELS, ("N", "N", "N", "N·m", "N·m", "N·m"), strict=True))
_RATIO: Final = {("N", "N·m"): "1/m", ("N·m", "N"): "m"}


@dataclass(frozen=True)
class Mechanism:
    """The parameters of an effect with their units, and the fields of `Flaws` that they set."""

    units: Mapping[str, str]
    fields: Callable[[Named], Fields]


@dataclass(frozen=True)
class Run:
    """What runs: with the rig's foot or without, torques renewed `update_hz` times a second for `duration_s`.

    `raw` samples torque steps without an anti-alias filter; `noise` is the thesis's.
    """

    foot: bool
    update_hz: float
    duration_s: float
    seed: int
    noise: bool
    raw: bool


def extended(
    run: Run, parameters: Entries, effects: Mapping[str, Entries], where: str
) -> tuple[PlatformRecording, Truth]:
    """Return what is recorded of the rig with `effects` and with the body that `parameters` tell, and its truth.

    Raises UserError, naming the field of `where`, for what the rig has no mechanism for.
    """
    flaws = combined([_fields(name, entries, where) for name, entries in effects.items()])
    if not run.foot and (flaws.tape_hz != (inf, inf) or flaws.foot_marker_m.any()):
        raise UserError(f"{where}: effects are of a foot, and none is on the plate: add --foot")
    jumps_hz = effects.get("aliasing", {}).get("update_hz", (run.update_hz, "Hz"))[0]
    unit = replace(_unit(run, parameters, where), update_hz=jumps_hz)
    flaws = replace(flaws, jumps=flaws.jumps or run.raw)
    random = np.random.default_rng(run.seed)
    torques = stepped(random, unit.update_hz, np.array(SPAN_NM), run.duration_s)
    laboratory = Laboratory(unit, flaws, PlateNoise(6, random))
    recording = laboratory.recorded(laboratory.ran(torques, run.duration_s), random, run.duration_s)
    return recording, Truth.of(unit.plate, unit.foot, unit.update_hz, run.seed)


def _unit(run: Run, parameters: Entries, where: str) -> PlatformUnit:
    """Return the rig with the body that `parameters` tell in place of its own."""
    plate, foot = PLATE, FOOT
    if parameters:
        body = "foot" if run.foot else "plate"
        known = {f"{body}_{name}": unit for name, unit in _BODY.items()}
        values = _checked(parameters, known, f"{where}: parameters")
        mass = {} if run.foot else {"plate_mass_kg": PLATE.mass_kg}
        missing = [name for name in known if name not in values and name not in mass]
        if missing:
            raise UserError(f"{where}: parameters.{missing[0]} is missing")
        told = {**mass, **values}
        try:
            found = Inertia.from_vector(np.array([told[name] for name in known])).checked()
        except ValueError as error:
            raise UserError(f"{where}: parameters: {error}") from error
        plate, foot = (plate, found) if run.foot else (found, foot)
    rig = Rig()
    return PlatformUnit(
        plate=plate,
        known=run.foot,
        foot=foot if run.foot else None,
        foot_origin_m=np.array(rig.foot_origin_m),
        joint_to_surface_m=rig.joint_to_surface_m,
        amplitude=1.0,
        update_hz=run.update_hz,
        noise_factor=1.0 if run.noise else 0.0,
        declared=run.noise,
        coloured=False,
    )


def _fields(effect: str, entries: Entries, where: str) -> Fields:
    if effect not in MECHANISMS:
        raise UserError(
            f"{where}: effects.{effect}: the rig has no mechanism for it; it simulates {', '.join(MECHANISMS)}"
        )
    mechanism = MECHANISMS[effect]
    values = _checked(entries, mechanism.units, f"{where}: effects.{effect}")
    if effect in ("backlash", "saturation") and len(values) > 1:
        raise UserError(f"{where}: effects.{effect}: the rig has it in one channel, not in {', '.join(values)}")
    return mechanism.fields(values)


def _checked(entries: Entries, units: Mapping[str, str], place: str) -> dict[str, float]:
    for name, (_, unit) in entries.items():
        if name not in units:
            raise unknown_name(f"{place}.{name}", name, units)
        if unit != units[name]:
            raise UserError(f'{place}.{name}.unit is "{unit}"; expected "{units[name]}"')
    return {name: value for name, (value, _) in entries.items()}


def _one(field: str, name: str, unit: str) -> Mechanism:
    return Mechanism({name: unit}, lambda values: {field: values[name]})


def _several(field: str, names: tuple[str, ...], unit: str) -> Mechanism:
    """Return a mechanism whose field is an array of the parameters in this order, zero where one is missing."""
    return Mechanism(
        dict.fromkeys(names, unit), lambda values: {field: np.array([values.get(name, 0.0) for name in names])}
    )


def _of_channel(field: str) -> Mechanism:
    return Mechanism(_OF, lambda values: {field: next((CHANNELS.index(k), v) for k, v in values.items())})


def _matrix(values: Named) -> Fields:
    matrix: FloatArray = np.eye(6)
    for name, share in values.items():
        of, _, source = name.partition("_from_")
        matrix[CHANNELS.index(of), CHANNELS.index(source or of)] += share
    return {"matrix": matrix}


def _mass(values: Named) -> Fields:
    at_m = np.array([values.get(axis, 0.0) for axis in _AXES_M])
    return {"masses": ((values.get("mass_kg", 0.0), at_m),)}


def _tape(values: Named) -> Fields:
    return {
        "tape_hz": (values.get("z_hz", inf), values.get("x_hz", inf)),
        "tape_zeta": values.get("zeta", 0.0),
        "tape_seen": values.get("seen", 0.0),
    }


def _tare(values: Named) -> Fields:
    return {"tare": np.array([values.get(name, 0.0) for name in CHANNELS])}


def _steps(values: Named) -> Fields:
    return {"step": (values.get("force_n", 0.0), values.get("torque_nm", 0.0))}


_AXES_M: Final = ("x_m", "y_m", "z_m")
MECHANISMS: Final[Mapping[str, Mechanism]] = {
    "force_delay": _one("delay_s", "value_s", "s"),
    "force_lag": _one("lag_s", "value_s", "s"),
    "clock_drift": _one("drift", "rate", "1"),
    "motion_smoothing": _one("smoothing_hz", "value_hz", "Hz"),
    "aliasing": Mechanism({"share": "1", "update_hz": "Hz", "offset_s": "s"}, lambda _: {"jumps": True}),
    "force_gain": Mechanism(dict.fromkeys(CHANNELS, "1"), _matrix),
    "crosstalk": Mechanism(
        {f"{of}_from_{source}": _RATIO.get((_OF[of], _OF[source]), "1") for of, source in permutations(CHANNELS, 2)},
        _matrix,
    ),
    "reference_height": _one("height_m", "value_m", "m"),
    "plate_rotation": _several("turn_rad", ("x_rad", "y_rad", "z_rad"), "rad"),
    "joint_offset": _several("joint_m", _AXES_M, "m"),
    "foot_marker_offset": _several("foot_marker_m", _AXES_M, "m"),
    "position_scale": _one("position_scale", "value", "1"),
    "parallel_spring": _several("spring_nmprad", ("z_nmprad", "x_nmprad"), "N·m/rad"),
    "parallel_damping": _several("damper_nmsprad", ("z_nmsprad", "x_nmsprad"), "N·m·s/rad"),
    "coulomb_friction": _several("friction_nm", ("z_nm", "x_nm"), "N·m"),
    "hidden_mass": Mechanism({"mass_kg": "kg", **dict.fromkeys(_AXES_M, "m")}, _mass),
    "tape_compliance": Mechanism({"z_hz": "Hz", "x_hz": "Hz", "zeta": "1", "seen": "1"}, _tape),
    "backlash": _of_channel("play"),
    "saturation": _of_channel("limit"),
    "quantisation": Mechanism({"force_n": "N", "torque_nm": "N·m"}, _steps),
    "tare_error": Mechanism(_OF, _tare),
}
"""Not here: `dropped_samples`, which tells what happened to the samples that were lost, but not how many are."""
