"""Effects planted into what a real IMU read beside a real reference: the recording has all its own effects as well.

Each is made where it happens, by other means than a model of readings needs: late or fast stamps are stamps, a lever
arm and a turned marker frame alter the reference, leaning axes are unit vectors turned by an angle, filters and mounts
are difference equations at the sensor's own rate, limits act on single readings. Nothing of the finder is used here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import bessel, butter, cont2discrete, dlsim, sosfilt, sosfilt_zi
from scipy.spatial.transform import Rotation, Slerp

from lab.hidden.case import TrueCause, sign
from lab.hidden.imu.cases import SIZES
from messages.arrays import FloatArray, IntArray

EFFECTS: Final = (
    "time_offset",
    "clock_drift",
    "gyro_bias",
    "gyro_bias_drift",
    "gyro_scale",
    "gyro_misalignment",
    "g_sensitivity",
    "acc_bias",
    "acc_scale",
    "acc_misalignment",
    "gravity_magnitude",
    "lever_arm",
    "frame_rotation",
    "world_tilt",
    "low_pass",
    "clipping",
    "vibration",
)
"""All of `SIZES` but `temperature`: real trials have no log of it, and without one it is a drift."""

_AXES: Final = "xyz"


@dataclass(frozen=True, eq=False)
class Recorded:
    """What an IMU read, `w_radps` and `sf_mps2` (n, 3) at the stamps `t_s` (n,), and what the cameras saw at
    `reference_t_s` (m,): `q_WS` (m, 4; w, x, y, z) sensor to world, z up, and `p_W_m` (m, 3), NaN where they lost it.
    """

    t_s: FloatArray
    w_radps: FloatArray
    sf_mps2: FloatArray
    reference_t_s: FloatArray
    q_WS: FloatArray
    p_W_m: FloatArray

    @property
    def rate_hz(self) -> float:
        """Return the rate of the samples."""
        return (len(self.t_s) - 1) / float(self.t_s[-1] - self.t_s[0])


@dataclass(frozen=True)
class Planting:
    """An effect drawn for a trial: `cause` holds what must change, `planted` makes it in any recording of the trial."""

    cause: TrueCause
    planted: Callable[[Recorded], Recorded]


Way = Callable[[Recorded], Recorded]
Drawn = tuple[dict[str, float], Way]
"""Parameters as a verdict tells them, but for gravity as what they change by; and what does it to a recording."""


def drawn(effect: str, random: np.random.Generator, fitted: Recorded) -> Planting:
    """Return one of `EFFECTS`, its size drawn from the stated range; `fitted` tells where a limit cuts off a share."""
    size = SIZES[effect].drawn(random)
    parameters, way = _DRAW[effect](size, random, fitted)
    return Planting(TrueCause(effect, parameters, size, SIZES[effect].unit), way)


def leaning(shares: FloatArray) -> FloatArray:
    """Return the sensitivity (3, 3) of a triad whose axis i, of unit length, leans towards j by the angle
    asin(`shares`[i, j]), one turn after the other.
    """
    rows = []
    for i in range(3):
        axis = np.eye(3)[i]
        for j in range(3):
            if shares[i, j]:
                axis = Rotation.from_rotvec(np.arcsin(shares[i, j]) * np.cross(np.eye(3)[i], np.eye(3)[j])).apply(axis)
        rows.append(axis)
    return np.array(rows)


def _on_axes(size: float, random: np.random.Generator) -> FloatArray:
    """Return a vector (3,) with the largest part `size`: along one axis, or with parts down to half of it on all."""
    if random.random() < 0.5:
        return np.asarray(sign(random) * size * np.eye(3)[int(random.integers(3))], dtype=np.float64)
    parts: FloatArray = size * random.choice((-1.0, 1.0), 3) * random.permutation((1.0, random.uniform(0.5, 1.0), 0.5))
    return parts


def _in_matrix(size: float, random: np.random.Generator, *, diagonal: bool) -> FloatArray:
    """Return a matrix (3, 3) with one entry of `size`, or with all between half of it and `size`."""
    places = np.argwhere(np.ones((3, 3), bool) if diagonal else ~np.eye(3, dtype=bool))
    if random.random() < 0.5:
        places = places[[int(random.integers(len(places)))]]
    matrix = np.zeros((3, 3))
    for row, column in places:
        matrix[row, column] = size * sign(random) * (1.0 if len(places) == 1 else random.uniform(0.5, 1.0))
    return matrix


def _told(form: str, values: FloatArray) -> dict[str, float]:
    return {form.format(_AXES[k]): float(values[k]) for k in np.flatnonzero(values)}


def _pairs(matrix: FloatArray) -> dict[str, float]:
    return {_AXES[row] + _AXES[column]: float(matrix[row, column]) for row, column in np.argwhere(matrix)}


def _since(recorded: Recorded) -> FloatArray:
    since_s: FloatArray = (recorded.t_s - recorded.t_s[0])[:, None]
    return since_s


def _time_offset(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    late_s = size * sign(random)
    return {"value_s": late_s}, lambda r: replace(r, t_s=r.t_s + late_s)


def _clock_drift(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    rate = size * sign(random)
    return {"rate": rate}, lambda r: replace(r, t_s=r.t_s[0] + (1.0 + rate) * (r.t_s - r.t_s[0]))


def _gyro_bias(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    bias = _on_axes(size, random)
    return _told("{}_radps", bias), lambda r: replace(r, w_radps=r.w_radps + bias)


def _gyro_bias_drift(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    drift = _on_axes(size, random)
    return _told("{}_radps2", drift), lambda r: replace(r, w_radps=r.w_radps + _since(r) * drift)


def _acc_bias(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    bias = _on_axes(size, random)
    return _told("{}_mps2", bias), lambda r: replace(r, sf_mps2=r.sf_mps2 + bias)


def _gyro_scale(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    shares = _on_axes(size, random)
    return _told("{}", shares), lambda r: replace(r, w_radps=r.w_radps * (1.0 + shares))


def _acc_scale(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    shares = _on_axes(size, random)
    return _told("{}", shares), lambda r: replace(r, sf_mps2=r.sf_mps2 * (1.0 + shares))


def _gyro_misalignment(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    shares = _in_matrix(size, random, diagonal=False)
    triad = leaning(shares)
    return _pairs(shares), lambda r: replace(r, w_radps=r.w_radps @ triad.T)


def _acc_misalignment(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    shares = _in_matrix(size, random, diagonal=False)
    triad = leaning(shares)
    return _pairs(shares), lambda r: replace(r, sf_mps2=r.sf_mps2 @ triad.T)


def _g_sensitivity(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    G = _in_matrix(size, random, diagonal=True)
    return _pairs(G), lambda r: replace(r, w_radps=r.w_radps + r.sf_mps2 @ G.T)


def _gravity_magnitude(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    more_mps2 = size * sign(random)
    return {"value_mps2": more_mps2}, lambda r: replace(r, sf_mps2=r.sf_mps2 + more_mps2 * _up(r))


def _lever_arm(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    arm_m = _on_axes(size, random)

    def elsewhere(r: Recorded) -> Recorded:
        """The cameras follow another point: that from which the sensor is `arm_m` away."""
        seen, turned = _attitude(r)
        p_W_m = np.full_like(r.p_W_m, np.nan)
        p_W_m[seen] = r.p_W_m[seen] - turned.apply(arm_m)
        return replace(r, p_W_m=p_W_m)

    return _told("{}_m", arm_m), elsewhere


def _frame_rotation(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    turn_rad = _on_axes(size, random)

    def turned_frame(r: Recorded) -> Recorded:
        """The cameras tell the attitude of a marker frame, from which the sensor's is turned back by `turn_rad`."""
        seen, attitude = _attitude(r)
        q_WS = np.full_like(r.q_WS, np.nan)
        q_WS[seen] = np.roll((attitude * Rotation.from_rotvec(turn_rad)).as_quat(), 1, axis=1)
        return replace(r, q_WS=q_WS)

    return _told("{}_rad", turn_rad), turned_frame


def _world_tilt(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    angle = random.uniform(0.0, 2.0 * np.pi)
    tilt_rad = size * np.array((np.cos(angle), np.sin(angle), 0.0))
    turn = Rotation.from_rotvec(tilt_rad)

    def leaning_world(r: Recorded) -> Recorded:
        """The cameras' world is turned so that the vertical is its z axis turned by `tilt_rad`."""
        seen, attitude = _attitude(r)
        q_WS, p_W_m = np.full_like(r.q_WS, np.nan), np.full_like(r.p_W_m, np.nan)
        q_WS[seen] = np.roll((turn * attitude).as_quat(), 1, axis=1)
        there = np.isfinite(r.p_W_m).all(axis=1)
        p_W_m[there] = turn.apply(r.p_W_m[there])
        return replace(r, q_WS=q_WS, p_W_m=p_W_m)

    return _told("{}_rad", tilt_rad), leaning_world


def _low_pass(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    """Return a second-order filter, Butterworth's or Bessel's, of one sensor or of both; −3 dB at the cut-off."""
    which, shared = int(random.integers(3)), float(random.uniform(0.7, 1.4))
    gyro_hz, acc_hz = size if which != 1 else np.inf, size * shared if which != 0 else np.inf
    flat_delay = bool(random.random() < 0.5)

    def filtered(values: FloatArray, cut_off_hz: float, rate_hz: float) -> FloatArray:
        if not np.isfinite(cut_off_hz):
            return values
        if flat_delay:
            sections = bessel(2, cut_off_hz, fs=rate_hz, output="sos", norm="mag")
        else:
            sections = butter(2, cut_off_hz, fs=rate_hz, output="sos")
        begun = sosfilt_zi(sections)[:, :, None] * values[0]
        return np.asarray(sosfilt(sections, values, axis=0, zi=begun)[0], dtype=np.float64)

    told = {name: value for name, value in (("gyro_hz", gyro_hz), ("acc_hz", acc_hz)) if np.isfinite(value)}
    return told, lambda r: replace(
        r, w_radps=filtered(r.w_radps, gyro_hz, r.rate_hz), sf_mps2=filtered(r.sf_mps2, acc_hz, r.rate_hz)
    )


def _clipping(size: float, random: np.random.Generator, fitted: Recorded) -> Drawn:
    """Return a limit that a share `size` of the fitted recording's samples touches on some axis."""
    of_gyroscope = random.random() < 0.5
    read = fitted.w_radps if of_gyroscope else fitted.sf_mps2
    limit = float(np.quantile(np.abs(read).max(axis=1), 1.0 - size))
    if of_gyroscope:
        return {"gyro_radps": limit}, lambda r: replace(r, w_radps=np.clip(r.w_radps, -limit, limit))
    return {"acc_mps2": limit}, lambda r: replace(r, sf_mps2=np.clip(r.sf_mps2, -limit, limit))


def _vibration(size: float, random: np.random.Generator, _: Recorded) -> Drawn:
    axes = np.flatnonzero(_on_axes(1.0, random))
    mount_hz = np.full(3, np.inf)
    mount_hz[axes] = size * random.uniform(0.8, 1.25, len(axes))
    damping = float(random.uniform(0.05, 0.2))

    def shaken(r: Recorded) -> Recorded:
        sf_mps2 = r.sf_mps2.copy()
        for k in axes:
            w0 = 2.0 * np.pi * float(mount_hz[k])
            spring, damper = w0**2, 2.0 * damping * w0
            swinging = np.array(((0.0, 1.0), (-spring, -damper)))  # of x, v with x¨ = u − spring x − damper x˙
            moved = cont2discrete(
                (swinging, np.array(((0.0,), (1.0,))), np.array(((spring, damper),)), np.zeros((1, 1))),
                1.0 / r.rate_hz,
                method="foh",
            )
            about = sf_mps2[0, k]
            sf_mps2[:, k] = about + dlsim((*moved[:4], 1.0 / r.rate_hz), sf_mps2[:, k] - about)[1][:, 0]
        return replace(r, sf_mps2=sf_mps2)

    return {f"{_AXES[k]}_hz": float(mount_hz[k]) for k in axes}, shaken


def _attitude(recorded: Recorded) -> tuple[IntArray, Rotation]:
    """Return the rows in which the cameras saw the sensor, and its attitudes there."""
    seen = np.flatnonzero(np.isfinite(recorded.q_WS).all(axis=1))
    return seen, Rotation.from_quat(np.roll(recorded.q_WS[seen], -1, axis=1))


def _up(recorded: Recorded) -> FloatArray:
    """Return the vertical (n, 3) in the sensor's axes at its stamps."""
    seen, attitude = _attitude(recorded)
    at_s = recorded.reference_t_s[seen]
    found: FloatArray = Slerp(at_s, attitude)(np.clip(recorded.t_s, at_s[0], at_s[-1])).apply(
        (0.0, 0.0, 1.0), inverse=True
    )
    return found


_DRAW: Final[Mapping[str, Callable[[float, np.random.Generator, Recorded], Drawn]]] = {
    "time_offset": _time_offset,
    "clock_drift": _clock_drift,
    "gyro_bias": _gyro_bias,
    "gyro_bias_drift": _gyro_bias_drift,
    "gyro_scale": _gyro_scale,
    "gyro_misalignment": _gyro_misalignment,
    "g_sensitivity": _g_sensitivity,
    "acc_bias": _acc_bias,
    "acc_scale": _acc_scale,
    "acc_misalignment": _acc_misalignment,
    "gravity_magnitude": _gravity_magnitude,
    "lever_arm": _lever_arm,
    "frame_rotation": _frame_rotation,
    "world_tilt": _world_tilt,
    "low_pass": _low_pass,
    "clipping": _clipping,
    "vibration": _vibration,
}
