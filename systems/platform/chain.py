"""The way from motion to the wrench that is read, and to the markers, with every effect at its place.

angles → smoothing undone → body, hidden mass, tape, spring, damper, friction → jumps → height, rotation
→ gains and crosstalk → lag, delay → drift → play → limit → rounding → repeats → tare error
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import TypeVar, cast

import numpy as np

from impedance.body.rigid_body import regressor
from messages.arrays import BoolArray, ComplexArray, FloatArray
from systems.platform import sensor
from systems.platform.band import Band
from systems.platform.jumps import aliased
from systems.platform.memory import with_play
from systems.platform.motion import Motion, unsmoothed
from systems.platform.sensor import CHANNELS
from systems.platform.tape import Carried, Rocking, rocking, shifted

ByEffect = Mapping[str, Mapping[str, float]]
"""Every effect of the library with all its parameters."""
_MOST_KEPT = 10
"""Intermediate results that are remembered: those of a few parameter values, each some megabytes."""
_FINER = 4
"""Times the rate at which play is followed: a turning point lies between two samples."""
_AXES_M = ("x_m", "y_m", "z_m")
_T = TypeVar("_T")


@dataclass(frozen=True)
class Stated:
    """What the recording says of plate and foot.

    `joint_m` (3,) is the lever from the joint to P's origin and `foot_m` that from there to F's, or None; `plate` (10,)
    its π, zeros where unknown; `tared` and `foot_tared` (6, 10) are the columns at rest that the tare took away from
    plate and foot; `to_plate` (10, 10) carries π from F to P.
    """

    joint_m: FloatArray
    foot_m: FloatArray | None
    plate: FloatArray
    tared: FloatArray
    foot_tared: FloatArray
    to_plate: FloatArray


@dataclass(frozen=True)
class Markers:
    """Positions (3, m) of plate and foot in I, and what the foot's markers tell of θ and φ, (2, m) or nothing."""

    positions_m: tuple[FloatArray, ...]
    rotations_rad: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Chain:
    """The prediction of one recording.

    `angles` is the spectrum (2, k) of the measured (θ, φ), `repeats` (n,) tells where the wrench is that of the sample
    before.
    """

    band: Band
    stated: Stated
    angles: ComplexArray
    repeats: BoolArray
    _kept: dict[tuple[object, ...], object] = field(default_factory=dict, compare=False, repr=False)

    def predicted(self, values: ByEffect, unknown: FloatArray, noise: FloatArray) -> tuple[FloatArray, Markers]:
        """Return the wrench (6, m) that is read, and the markers, below the band's limit.

        `unknown` (10,) is the π that the recording does not state, the foot's about F's origin or else the plate's;
        `noise` (6,) what scatters a sample before it is rounded.
        """
        cutoff_hz, offset_m = values["motion_smoothing"]["value_hz"], _triple(values["joint_offset"])
        columns = self.columns_of(cutoff_hz, offset_m)
        raw = self._rigid(columns, unknown, _point_mass(values["hidden_mass"]))
        rocks = self._rocking(values, columns, unknown)
        if rocks is not None:
            raw = raw + rocks.wrench
        for moment in self._straps(values):
            raw[3:] += moment
        jumps = values["aliasing"]
        if jumps["share"] != 0.0:
            raw += jumps["share"] * aliased(raw, self.band, jumps["update_hz"], jumps["offset_s"])
        matrix = _matrix(values)
        spectrum = self.band.spectrum(raw if matrix is None else matrix @ raw)
        delay_s, lag_s = values["force_delay"]["value_s"], values["force_lag"]["value_s"]
        if delay_s != 0.0 or lag_s != 0.0:
            jw = 2j * np.pi * self.band.f_hz
            spectrum *= np.exp(-jw * delay_s) / (1.0 + jw * lag_s)
        if _bends(values):
            spectrum = self.band.spectrum(self._bent(values, spectrum, noise))
        wrench = self.band.reduced(spectrum)
        for name, constant in values["tare_error"].items():
            if constant != 0.0:
                wrench[CHANNELS.index(name)] += constant
        return wrench, self._markers(values, rocks)

    def motion_of(self, cutoff_hz: float) -> Motion:
        """Return the motion, a smoothing with this cut-off undone, of which an infinite one does nothing."""
        return self._once(
            ("motion", cutoff_hz),
            lambda: Motion.of(
                unsmoothed(self.angles, self.band, cutoff_hz) if isfinite(cutoff_hz) else self.angles, self.band
            ),
        )

    def columns_of(self, cutoff_hz: float, offset_m: FloatArray) -> FloatArray:
        """Return (Y − Y⁰) in P, its ten columns first, (10, 6 n); `offset_m` (3,) is what the joint's lever lacks."""
        lever_m = self.stated.joint_m + offset_m
        return self._once(
            ("columns", cutoff_hz, *lever_m.tolist()),
            lambda: self.motion_of(cutoff_hz).columns(lever_m, self.stated.tared),
        )

    def base_columns(self) -> FloatArray:
        """Return the columns of the base model, (10, 6 n)."""
        return self.columns_of(inf, np.zeros(3))

    def base_wrench(self, unknown: FloatArray) -> FloatArray:
        """Return the wrench (6, n) of plate and foot as rigid bodies, tared."""
        return self._rigid(self.base_columns(), unknown, np.zeros(10))

    def _rigid(self, columns: FloatArray, unknown: FloatArray, hidden: FloatArray) -> FloatArray:
        """Return the wrench (6, n) of plate, foot and a hidden mass π (10,) as rigid bodies, tared."""
        stated, body = self.stated, unknown
        if stated.foot_m is not None:
            foot = stated.to_plate @ unknown
            body = stated.plate + foot
        wrench: FloatArray = ((body + hidden) @ columns).reshape(6, -1)
        if stated.foot_m is not None:
            wrench += ((stated.tared - stated.foot_tared) @ foot)[:, None]
        return wrench

    def level_slope(self, unknown: FloatArray) -> FloatArray:
        """Return ∂ wrench / ∂ (θ̈, φ̈) (6, 2), level."""
        alpha = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
        none = np.zeros((2, 3))
        stated = self.stated
        body = unknown if stated.foot_m is None else stated.plate + stated.to_plate @ unknown
        slope: FloatArray = (regressor(np.cross(alpha, stated.joint_m), none, none, alpha) @ body).T
        return slope

    def _rocking(self, values: ByEffect, columns: FloatArray, unknown: FloatArray) -> Rocking | None:
        """Return how the foot rocks, whose rigid wrench is `columns` times its π; None where the tape does not give."""
        if self.stated.foot_m is None:
            return None
        tape = values["tape_compliance"]
        resonances_hz = (tape["z_hz"], tape["x_hz"])
        if not any(isfinite(hz) for hz in resonances_hz):
            return None
        foot = self.stated.to_plate @ unknown
        lever_m = self.stated.joint_m + _triple(values["joint_offset"])
        cutoff_hz = values["motion_smoothing"]["value_hz"]
        motion = self._once(
            ("carried", cutoff_hz, *lever_m.tolist()),
            lambda: Carried.of(self.motion_of(cutoff_hz).kinematics(lever_m)),
        )
        rigid, rest = (foot @ columns).reshape(6, -1), self.stated.tared @ foot
        return rocking(self.band, foot, motion, rigid, rest, resonances_hz, tape["zeta"])

    def _straps(self, values: ByEffect) -> list[FloatArray]:
        """Return the moments (3, n) in P that hold spring, damper and friction at bay, about I's Z and P's X."""
        springs, dampers, rubs = (values[name] for name in ("parallel_spring", "parallel_damping", "coulomb_friction"))
        if not (_any(springs) or _any(dampers) or _any(rubs)):
            return []
        motion = self.motion_of(values["motion_smoothing"]["value_hz"])
        about = []
        for row, axis in enumerate("zx"):
            angle, rate = motion.angles_rad[row], motion.rates_radps[row]
            moment = springs[f"{axis}_nmprad"] * angle + dampers[f"{axis}_nmsprad"] * rate
            rub_nm = rubs[f"{axis}_nm"]
            about.append(moment if rub_nm == 0.0 else moment + rub_nm * motion.direction(row, self.band.rate_hz))
        phi = motion.angles_rad[1]
        return [np.stack((about[1], about[0] * np.sin(phi), about[0] * np.cos(phi)))]

    def _bent(self, values: ByEffect, spectrum: ComplexArray, noise: FloatArray) -> FloatArray:
        """Return the wrench (6, n) behind all that is no factor per frequency.

        What play makes follows from the turning points, which lie between samples: it sees `_FINER` times as many,
        below the band's limit.
        """
        wrench = self.band.full(spectrum)
        for name, play in values["backlash"].items():
            if play != 0.0:
                k = CHANNELS.index(name)
                fine = self.band.full(spectrum[k : k + 1], _FINER)[0]
                wrench[k] += (with_play(fine, 0.5 * play, float(fine[0])) - fine)[::_FINER]
        drift = values["clock_drift"]["rate"]
        if drift != 0.0:
            wrench = self.band.stretched(self.band.spectrum(wrench), drift)
        for name, limit in values["saturation"].items():
            if isfinite(limit):
                k = CHANNELS.index(name)
                wrench[k] = np.clip(wrench[k], -limit, limit)
        for name, first in (("force_n", 0), ("torque_nm", 3)):
            step = values["quantisation"][name]
            if step > 0.0:
                for k in range(first, first + 3):
                    wrench[k] = sensor.rounded(wrench[k], step, float(noise[k]))
        share = values["dropped_samples"]["held"]
        return wrench if share == 0.0 else sensor.held(wrench, self.repeats, share)

    def _markers(self, values: ByEffect, rocks: Rocking | None) -> Markers:
        """Return what the markers show; they are compared as smoothed as they are."""
        stated, band = self.stated, self.band

        def reduced() -> FloatArray:
            seen = self.motion_of(inf)
            rows = np.vstack((seen.R_IP.transpose(1, 2, 0).reshape(9, -1), seen.angles_rad))
            return band.reduced(band.spectrum(rows))

        rows = self._once(("markers",), reduced)
        R_IP = rows[:9].reshape(3, 3, -1)
        scale = 1.0 + values["position_scale"]["value"]
        lever_m = stated.joint_m + _triple(values["joint_offset"])
        plate_m = scale * np.einsum("rcm,c->rm", R_IP, lever_m)
        if stated.foot_m is None:
            return Markers((plate_m,), ())
        foot_m = stated.foot_m + _triple(values["foot_marker_offset"])
        placed = np.einsum("rcm,c->rm", R_IP, lever_m + foot_m)
        rotations = rows[9:]
        share = values["tape_compliance"]["seen"]
        if rocks is not None and share != 0.0:
            R_full = self._once(("seen",), lambda: self.motion_of(inf).R_IP.transpose(1, 2, 0).reshape(9, -1).copy())
            more = np.concatenate(shifted(R_full, share * rocks.turns_rad, foot_m))
            more = band.reduced(band.spectrum(more))
            placed, rotations = placed + more[:3], rotations + more[3:]
        return Markers((plate_m, scale * placed), (rotations,))

    def _once(self, key: tuple[object, ...], made: Callable[[], _T]) -> _T:
        """Return what was made for `key`, made only once while it is among the last few."""
        if key not in self._kept:
            if len(self._kept) >= _MOST_KEPT:
                del self._kept[next(each for each in self._kept if not self._neutral(each))]
            self._kept[key] = made()
        return cast(_T, self._kept[key])

    def _neutral(self, key: tuple[object, ...]) -> bool:
        """Tell whether what `key` names belongs to the base model, to which every search returns."""
        return key[1:] in ((), (inf,), (inf, *self.stated.joint_m.tolist()))


def _any(parameters: Mapping[str, float]) -> bool:
    """Tell whether one of an effect's parameters, all neutral at zero, is not neutral."""
    return any(value != 0.0 for value in parameters.values())


def _triple(parameters: Mapping[str, float]) -> FloatArray:
    return np.array([parameters[axis] for axis in _AXES_M])


def _point_mass(hidden: Mapping[str, float]) -> FloatArray:
    """Return the π (10,) of a point mass on the plate."""
    vector = np.zeros(10)
    mass_kg = hidden["mass_kg"]
    if mass_kg != 0.0:
        x, y, z = _triple(hidden)
        vector[0] = mass_kg
        vector[1:4] = mass_kg * np.array([x, y, z])
        vector[4:] = mass_kg * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -y * z, -x * z, -x * y])
    return vector


def _matrix(values: ByEffect) -> FloatArray | None:
    """Return what gains, crosstalk, height and rotation make of a wrench (6, 6), or None if nothing."""
    gains, crosstalk, turns = values["force_gain"], values["crosstalk"], values["plate_rotation"]
    height_m = values["reference_height"]["value_m"]
    if not (_any(gains) or _any(crosstalk) or _any(turns) or height_m != 0.0):
        return None
    amplifier = np.eye(6)
    for name, gain in gains.items():
        amplifier[CHANNELS.index(name), CHANNELS.index(name)] += gain
    for name, share in crosstalk.items():
        of, _, source = name.partition("_from_")
        amplifier[CHANNELS.index(of), CHANNELS.index(source)] += share
    rotation = np.array([turns[axis] for axis in ("x_rad", "y_rad", "z_rad")])
    matrix: FloatArray = amplifier @ sensor.turned(rotation) @ sensor.about_height(height_m)
    return matrix


def _bends(values: ByEffect) -> bool:
    """Tell whether anything acts that is no matter of one factor per frequency."""
    at_zero = ("clock_drift", "backlash", "quantisation", "dropped_samples")
    return any(_any(values[name]) for name in at_zero) or any(map(isfinite, values["saturation"].values()))
