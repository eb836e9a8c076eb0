"""A recording of the platform as a simulation that can be held against it.

    wrench = (Y − Y⁰) π_P + Y π_F'   (Y − Y⁰ for both if the foot stood there at the tare)                        (1)

out of the motion that the angles tell, and the markers' positions out of the same motion. The base model's parameters
are the foot's ten π_F, about F's origin, or the plate's but its mass where no earlier run told them; else there are
none. The streams' times are believed. Channels are the six of the wrench, the positions along three skew axes, so that
each of them sees the swing, and the foot's two angles, all below 60 Hz (`band`).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from pathlib import Path

import numpy as np

from discrepancy.simulation import Channels, Effect, Parameter, Values
from impedance.identification.mechanism import level_rest
from impedance.identification.noise_level import noise_level
from impedance.identification.observability import moving
from impedance.recording.recording import WRENCH_COLUMNS, PlatformRecording, Poses
from impedance.recording.synchronous import Synchronous, synchronous
from messages.arrays import FloatArray
from messages.errors import UserError
from systems.platform.band import Band, bridged
from systems.platform.chain import ByEffect, Chain, Stated
from systems.platform.effects import amplitudes, geometry, timing
from systems.platform.effects_above import above_sensor, sampling
from systems.platform.jumps import rhythm
from systems.platform.sensor import CHANNELS, lattice, repeats

SKEW = np.eye(3) - 2.0 / 3.0
"""Three perpendicular axes, each with a share of x, y and z."""
_POSITIONS = ("a_m", "b_m", "c_m")
_ROTATIONS = ("theta_rad", "phi_rad")
INPUT_NAMES = tuple(f"{axis}_{unit}" for unit in ("rad", "radps", "radps2") for axis in ("theta", "phi"))
BODY = ("mass_kg", "mx_kgm", "my_kgm", "mz_kgm", "jxx_kgm2", "jyy_kgm2", "jzz_kgm2", "jyz_kgm2", "jxz_kgm2", "jxy_kgm2")
_UNITS = ("kg", "kg·m", "kg·m", "kg·m", *("kg·m²",) * 6)
_SCALES = (0.1, 0.01, 0.01, 0.01, *(0.01,) * 6)
"""In `_UNITS`: changes of a foot's or a plate's parameters that matter."""
_BOUNDS = (1e3, 1e3, 1e3, 1e3, *(1e3,) * 6)
"""In `_UNITS`, either way: far beyond any foot or plate, so that none is met."""
_ROUNDING_N, _ROUNDING_NM = 5.0, 1.0
"""Steps of rounding that a fit begins with where the readings show none: coarse enough to change the prediction."""
_LEAST_DEVIATION = 1e-9
"""Of a channel, N or N·m, as a divisor: one that does not vary weighs no more."""
MOST_S = 30.0
"""What is compared of a recording: enough for the sizes that matter, and few enough samples for a verdict in 10 s."""


@dataclass(frozen=True)
class PlatformSimulation:
    """One recording, bound. `streams` hold it, `stated` is what the file says of plate and foot."""

    streams: Synchronous
    band: Band
    stated: Stated
    chain: Chain

    @classmethod
    def of(cls, recording: PlatformRecording) -> "PlatformSimulation":
        """Bind the first 30 s of a recording.

        Raises UserError where it is too short or the plate under a foot is not known.
        """
        streams = _first(synchronous(recording), MOST_S)
        settings = streams.settings
        plate = settings.plate.inertia
        if streams.foot is not None and plate is None:
            raise UserError("platform.toml: plate.cog_m, plate.inertia_kgm2: needed to know what the foot adds")
        band = Band(streams.rate_hz, streams.valid)
        foot_m = None if streams.foot is None else np.array(settings.foot.origin_in_plate_m)
        stated = Stated(
            joint_m=np.array([0.0, settings.plate.joint_to_surface_m, 0.0]),
            foot_m=foot_m,
            plate=np.zeros(10) if plate is None else plate.vector,
            tared=level_rest(),
            foot_tared=level_rest() if settings.tare.with_foot else np.zeros((6, 10)),
            to_plate=np.eye(10) if foot_m is None else moving(-foot_m),
        )
        angles = band.spectrum(bridged(streams.plate.euler_rad[:, 1:], streams.valid))
        return cls(streams, band, stated, Chain(band, stated, angles, repeats(streams.wrench)))

    @property
    def system(self) -> str:
        """Return the system's name."""
        return "platform"

    @cached_property
    def channels(self) -> Channels:
        """Return what was measured, below 60 Hz."""
        streams, valid = self.streams, self.streams.valid
        parts, names = [bridged(streams.wrench, valid)], list(WRENCH_COLUMNS)
        for frame, poses in (("plate", streams.plate), ("foot", streams.foot)):
            if poses is not None:
                parts.append(bridged(poses.p_m @ SKEW, valid))
                names += [f"{frame}_{name}" for name in _POSITIONS]
        if streams.foot is not None:
            parts.append(bridged(streams.foot.euler_rad[:, 1:], valid))
            names += [f"foot_{name}" for name in _ROTATIONS]
        values = self.band.reduced(self.band.spectrum(np.vstack(parts))).T
        values = np.where(self.band.kept[:, None], values, np.nan)
        moves = self.chain.motion_of(inf)
        inputs = np.vstack((moves.angles_rad, moves.rates_radps, moves.accelerations_radps2))
        return Channels(
            t_s=streams.t_s[0] + self.band.t_s,
            values=np.ascontiguousarray(values),
            names=tuple(names),
            inputs=self.band.reduced(self.band.spectrum(inputs)).T,
            input_names=INPUT_NAMES,
            noise_std=self._noise_std,
        )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the foot's ten, or the plate's nine, or nothing; they start at the least squares of the wrench."""
        if not self._unknown:
            return ()
        body = "plate" if self.stated.foot_m is None else "foot"
        return tuple(
            Parameter(f"{body}_{BODY[k]}", _UNITS[k], float(start), -_BOUNDS[k], _BOUNDS[k], _SCALES[k])
            for k, start in zip(self._unknown, self._start, strict=True)
        )

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Return the library, its starts suited to the recording."""
        measured = self.streams.wrench[self.streams.valid]
        largest = dict(zip(CHANNELS, np.abs(measured).max(axis=0).tolist(), strict=True))
        steps = [lattice(column) for column in measured.T]
        foot = self.stated.foot_m is not None
        rounding = {
            "force_n": max((s for s in steps[:3] if s is not None), default=_ROUNDING_N),
            "torque_nm": max((s for s in steps[3:] if s is not None), default=_ROUNDING_NM),
        }
        return (
            *timing(),
            *amplitudes(rounding, largest),
            *geometry(foot),
            *above_sensor(foot),
            *sampling(*self._rhythm),
        )

    def predicted(self, values: Values) -> FloatArray:
        """Return wrench and markers (m, c) below 60 Hz; NaN near gaps."""
        wrench, markers = self.chain.predicted(_by_effect(values), self._body(values), self._rounded_noise)
        everything = np.vstack((wrench, *(SKEW @ position for position in markers.positions_m), *markers.rotations_rad))
        if not self.band.kept.all():
            everything[:, ~self.band.kept] = np.nan
        return np.ascontiguousarray(everything.T)

    @cached_property
    def _rhythm(self) -> tuple[float, float]:
        """Return the rate (Hz) at which the wrench seems to jump, and the first jump (s)."""
        band = self.band
        predicted = self.chain.base_wrench(self._started)
        left = bridged(self.streams.wrench, self.streams.valid) - predicted
        return rhythm(predicted, band.full(band.spectrum(left) * band.limit), band.rate_hz)

    @property
    def _unknown(self) -> tuple[int, ...]:
        if self.stated.foot_m is not None:
            return tuple(range(10))
        return () if self.stated.plate.any() else tuple(range(1, 10))

    def _body(self, values: Values) -> FloatArray:
        """Return the unknown body's π (10,): the foot about F's origin, or the plate."""
        return self._unknown_body([values[p.name] for p in self.parameters])

    @cached_property
    def _started(self) -> FloatArray:
        """Return the unknown body's π (10,) where the base model's fit begins."""
        return self._unknown_body([p.neutral for p in self.parameters])

    def _unknown_body(self, parameters: list[float]) -> FloatArray:
        if not self._unknown:
            return self.stated.plate
        vector = np.zeros(10)
        vector[0] = self.streams.settings.plate.mass_kg
        vector[list(self._unknown)] = parameters
        return vector

    @cached_property
    def _start(self) -> FloatArray:
        """Return the least squares of the wrench for what is unknown, each channel by its own size."""
        band, stated = self.band, self.stated
        columns = self.chain.base_columns().reshape(10, 6, -1)
        moved = np.stack([band.reduced(band.spectrum(column)) for column in columns])
        if stated.foot_m is None:
            known = np.zeros(10)
            known[0] = self.streams.settings.plate.mass_kg
            unknown = moved
        else:
            known = stated.plate
            unknown = moved + (stated.tared - stated.foot_tared).T[:, :, None]
        unknown = np.einsum("pq,pwm->qwm", stated.to_plate, unknown)[list(self._unknown)]
        measured = band.reduced(band.spectrum(bridged(self.streams.wrench, self.streams.valid)))
        left = measured - np.einsum("p,pwm->wm", known, moved)
        weight = 1.0 / np.maximum(left.std(axis=1), _LEAST_DEVIATION)[:, None]
        A = (unknown * weight)[:, :, band.kept].reshape(len(unknown), -1)
        found: FloatArray = np.linalg.lstsq(A.T, (left * weight)[:, band.kept].reshape(-1), rcond=None)[0]
        return found

    @cached_property
    def _rounded_noise(self) -> FloatArray:
        """Return what scatters a sample (6,) about its prediction: the sensor as declared, and the angles."""
        noise = self.streams.settings.noise
        angle_rad = noise_level(self.streams).angle_rad
        moved = angle_rad * self.band.noise_gain(2, self.band.motion_limit) * self._per_acceleration
        scatter: FloatArray = np.hypot(np.repeat((noise.force_n or 0.0, noise.torque_nm or 0.0), 3), moved)
        return scatter

    @cached_property
    def _per_acceleration(self) -> FloatArray:
        """Return by how much the wrench (6,) scatters with that of both angular accelerations."""
        slope = self.chain.level_slope(self._started)
        spread: FloatArray = np.sqrt((slope**2).sum(axis=1))
        return spread

    @cached_property
    def _noise_std(self) -> FloatArray | None:
        """Return the noise (c,) of a sample, an upper bound where the sensor's has a colour; None if undeclared."""
        noise, frames = self.streams.settings.noise, 1 if self.stated.foot_m is None else 2
        if None in (noise.position_m, noise.angle_rad, noise.force_n, noise.torque_nm):
            return None
        position_m, angle_rad, force_n, torque_nm = (
            float(each or 0.0) for each in (noise.position_m, noise.angle_rad, noise.force_n, noise.torque_nm)
        )
        still = self.band.noise_gain(0, self.band.limit)
        moved = angle_rad * self.band.noise_gain(2, self.band.limit) * self._per_acceleration
        wrench = np.hypot(np.repeat((force_n, torque_nm), 3), moved)
        rotations = np.repeat(np.sqrt(2.0) * angle_rad, 2 * (frames - 1))
        return np.concatenate((wrench, np.repeat(position_m, 3 * frames) * still, rotations * still))


def _by_effect(values: Values) -> ByEffect:
    """Return the parameters of every effect by their own names."""
    found: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        effect, dot, parameter = key.partition(".")
        if dot:
            found.setdefault(effect, {})[parameter] = value
    return found


def _first(streams: Synchronous, seconds: float) -> Synchronous:
    n = min(len(streams.t_s), round(seconds * streams.rate_hz))
    return replace(
        streams,
        t_s=streams.t_s[:n],
        plate=Poses.from_columns(streams.plate.columns[:n]),
        foot=None if streams.foot is None else Poses.from_columns(streams.foot.columns[:n]),
        wrench=streams.wrench[:n],
        valid=streams.valid[:n],
    )


def load(folder: Path) -> PlatformSimulation:
    """Return the simulation bound to the recording in `folder`; raises UserError, one line, for what cannot be used."""
    return PlatformSimulation.of(PlatformRecording.load(folder))
