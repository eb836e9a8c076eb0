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

Acting = Mapping[str, Mapping[str, float]]
"""Effects with those of their parameters that are not missing."""
_MOST_KEPT = 10
_FINER = 4
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

    def predicted(self, acting: Acting, unknown: FloatArray, noise: FloatArray) -> tuple[FloatArray, Markers]:
        """Return the wrench (6, m) that is read, and the markers, below the band's limit.

        `unknown` (10,) is the π that the recording does not state, the foot's about F's origin or else the plate's;
        `noise` (6,) what scatters a sample before it is rounded.
        """
        raw = self.wrench_of(acting, unknown)
        rocks = self._rocking(acting, unknown)
        if rocks is not None:
            raw = raw + rocks.wrench
        for moment in self._straps(acting):
            raw[3:] += moment
        jumps = acting.get("aliasing", {})
        if jumps.get("share", 0.0) != 0.0:
            raw += jumps["share"] * aliased(raw, self.band, jumps["update_hz"], jumps["offset_s"])
        matrix = _matrix(acting)
        spectrum = self.band.spectrum(raw if matrix is None else matrix @ raw)
        delay_s, lag_s = (acting.get(name, {}).get("value_s", 0.0) for name in ("force_delay", "force_lag"))
        if delay_s != 0.0 or lag_s != 0.0:
            jw = 2j * np.pi * self.band.f_hz
            spectrum *= np.exp(-jw * delay_s) / (1.0 + jw * lag_s)
        if _bends(acting):
            spectrum = self.band.spectrum(self._bent(acting, spectrum, noise))
        wrench = self.band.reduced(spectrum)
        for name, value in acting.get("tare_error", {}).items():
            wrench[CHANNELS.index(name)] += value
        return wrench, self._markers(acting, rocks)

    def motion_of(self, acting: Acting) -> Motion:
        """Return the motion, smoothing undone."""
        cutoff_hz = acting.get("motion_smoothing", {}).get("value_hz", inf)
        return self._once(
            ("motion", cutoff_hz),
            lambda: Motion.of(
                unsmoothed(self.angles, self.band, cutoff_hz) if isfinite(cutoff_hz) else self.angles, self.band
            ),
        )

    def columns_of(self, acting: Acting) -> FloatArray:
        """Return (Y − Y⁰) in P, its ten columns first, (10, 6 n)."""
        lever_m = self.stated.joint_m + _triple(acting, "joint_offset")
        cutoff_hz = acting.get("motion_smoothing", {}).get("value_hz", inf)
        return self._once(
            ("columns", cutoff_hz, *lever_m.tolist()),
            lambda: self.motion_of(acting).columns(lever_m, self.stated.tared),
        )

    def wrench_of(self, acting: Acting, unknown: FloatArray) -> FloatArray:
        """Return the wrench (6, n) of plate, foot and hidden mass as rigid bodies, tared."""
        stated, body = self.stated, unknown
        if stated.foot_m is not None:
            foot = stated.to_plate @ unknown
            body = stated.plate + foot
        wrench = (body + _hidden(acting)) @ self.columns_of(acting)
        wrench = wrench.reshape(6, -1)
        if stated.foot_m is not None:
            wrench += ((stated.tared - stated.foot_tared) @ foot)[:, None]
        return cast(FloatArray, wrench)

    def level_slope(self, unknown: FloatArray) -> FloatArray:
        """Return ∂ wrench / ∂ (θ̈, φ̈) (6, 2), level."""
        alpha = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
        none = np.zeros((2, 3))
        stated = self.stated
        body = unknown if stated.foot_m is None else stated.plate + stated.to_plate @ unknown
        slope: FloatArray = (regressor(np.cross(alpha, stated.joint_m), none, none, alpha) @ body).T
        return slope

    def _rocking(self, acting: Acting, unknown: FloatArray) -> Rocking | None:
        tape = acting.get("tape_compliance", {})
        resonances_hz = (tape.get("z_hz", inf), tape.get("x_hz", inf))
        if self.stated.foot_m is None or not any(isfinite(hz) for hz in resonances_hz):
            return None
        foot = self.stated.to_plate @ unknown
        rigid = (foot @ self.columns_of(acting)).reshape(6, -1)
        lever_m = self.stated.joint_m + _triple(acting, "joint_offset")
        cutoff_hz = acting.get("motion_smoothing", {}).get("value_hz", inf)
        motion = self._once(
            ("carried", cutoff_hz, *lever_m.tolist()),
            lambda: Carried.of(self.motion_of(acting).kinematics(lever_m)),
        )
        rest = self.stated.tared @ foot
        return rocking(self.band, foot, motion, rigid, rest, resonances_hz, tape.get("zeta", 0.0))

    def _straps(self, acting: Acting) -> list[FloatArray]:
        """Return the moments (3, n) in P that hold spring, damper and friction at bay, about I's Z and P's X."""
        springs, dampers, rubs = (
            acting.get(name, {}) for name in ("parallel_spring", "parallel_damping", "coulomb_friction")
        )
        if not (springs or dampers or rubs):
            return []
        motion = self.motion_of(acting)
        about = []
        for row, axis in enumerate("zx"):
            angle, rate = motion.angles_rad[row], motion.rates_radps[row]
            moment = springs.get(f"{axis}_nmprad", 0.0) * angle + dampers.get(f"{axis}_nmsprad", 0.0) * rate
            rub_nm = rubs.get(f"{axis}_nm", 0.0)
            about.append(moment if rub_nm == 0.0 else moment + rub_nm * motion.direction(row, self.band.rate_hz))
        phi = motion.angles_rad[1]
        return [np.stack((about[1], about[0] * np.sin(phi), about[0] * np.cos(phi)))]

    def _bent(self, acting: Acting, spectrum: ComplexArray, noise: FloatArray) -> FloatArray:
        """Return the wrench (6, n) behind all that is no factor per frequency.

        What play makes follows from the turning points, which lie between samples: it sees four times as many, below
        the band's limit.
        """
        wrench = self.band.full(spectrum)
        for name, play in acting.get("backlash", {}).items():
            if play != 0.0:
                k = CHANNELS.index(name)
                fine = self.band.full(spectrum[k : k + 1], _FINER)[0]
                wrench[k] += (with_play(fine, 0.5 * play, float(fine[0])) - fine)[::_FINER]
        drift = acting.get("clock_drift", {}).get("rate", 0.0)
        if drift != 0.0:
            wrench = self.band.stretched(self.band.spectrum(wrench), drift)
        for name, limit in acting.get("saturation", {}).items():
            k = CHANNELS.index(name)
            wrench[k] = np.clip(wrench[k], -limit, limit)
        for name, first in (("force_n", 0), ("torque_nm", 3)):
            step = acting.get("quantisation", {}).get(name, 0.0)
            if step > 0.0:
                for k in range(first, first + 3):
                    wrench[k] = sensor.rounded(wrench[k], step, float(noise[k]))
        share = acting.get("dropped_samples", {}).get("held", 0.0)
        return wrench if share == 0.0 else sensor.held(wrench, self.repeats, share)

    def _markers(self, acting: Acting, rocks: Rocking | None) -> Markers:
        """Return what the markers show; they are compared as smoothed as they are."""
        stated, band = self.stated, self.band

        def reduced() -> FloatArray:
            seen = self.motion_of({})
            rows = np.vstack((seen.R_IP.transpose(1, 2, 0).reshape(9, -1), seen.angles_rad))
            return band.reduced(band.spectrum(rows))

        rows = self._once(("markers",), reduced)
        R_IP = rows[:9].reshape(3, 3, -1)
        scale = 1.0 + acting.get("position_scale", {}).get("value", 0.0)
        lever_m = stated.joint_m + _triple(acting, "joint_offset")
        plate_m = scale * np.einsum("rcm,c->rm", R_IP, lever_m)
        if stated.foot_m is None:
            return Markers((plate_m,), ())
        foot_m = stated.foot_m + _triple(acting, "foot_marker_offset")
        placed = np.einsum("rcm,c->rm", R_IP, lever_m + foot_m)
        rotations = rows[9:]
        share = acting.get("tape_compliance", {}).get("seen", 0.0)
        if rocks is not None and share != 0.0:
            R_full = self._once(("seen",), lambda: self.motion_of({}).R_IP.transpose(1, 2, 0).reshape(9, -1).copy())
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


def _triple(acting: Acting, effect: str) -> FloatArray:
    found = acting.get(effect, {})
    return np.array([found.get(axis, 0.0) for axis in _AXES_M])


def _hidden(acting: Acting) -> FloatArray:
    """Return the π (10,) of a point mass on the plate."""
    hidden = acting.get("hidden_mass", {})
    vector = np.zeros(10)
    mass_kg = hidden.get("mass_kg", 0.0)
    if mass_kg != 0.0:
        x, y, z = _triple(acting, "hidden_mass")
        vector[0] = mass_kg
        vector[1:4] = mass_kg * np.array([x, y, z])
        vector[4:] = mass_kg * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -y * z, -x * z, -x * y])
    return vector


def _matrix(acting: Acting) -> FloatArray | None:
    """Return what gains, crosstalk, height and rotation make of a wrench (6, 6), or None if nothing."""
    gains, crosstalk = acting.get("force_gain", {}), acting.get("crosstalk", {})
    turns = acting.get("plate_rotation", {})
    height_m = acting.get("reference_height", {}).get("value_m", 0.0)
    if not (any(gains.values()) or any(crosstalk.values()) or any(turns.values()) or height_m != 0.0):
        return None
    amplifier = np.eye(6)
    for name, gain in gains.items():
        amplifier[CHANNELS.index(name), CHANNELS.index(name)] += gain
    for name, share in crosstalk.items():
        of, _, source = name.partition("_from_")
        amplifier[CHANNELS.index(of), CHANNELS.index(source)] += share
    rotation = np.array([turns.get(axis, 0.0) for axis in ("x_rad", "y_rad", "z_rad")])
    matrix: FloatArray = amplifier @ sensor.turned(rotation) @ sensor.about_height(height_m)
    return matrix


def _bends(acting: Acting) -> bool:
    """Tell whether anything acts that is no matter of one factor per frequency."""
    return any(
        value != 0.0
        for name in ("clock_drift", "backlash", "quantisation", "dropped_samples")
        for value in acting.get(name, {}).values()
    ) or any(isfinite(limit) for limit in acting.get("saturation", {}).values())
