"""Where in a log the IMU rests, and which ways up it has lain."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from calib.imu.log import ImuLog
from messages.arrays import BoolArray, FloatArray

WINDOW_S = 0.5
LEAST_REST_S = 1.0
_QUIET_TIMES = 4.0
"""By how much more than in the log's quietest moments samples may scatter at rest."""
_QUIET_SF, _MOST_SF = 0.010, 0.030
"""Of gravity's length: what may scatter anyway, on a table, and at most, held in hands."""
_QUIET_W, _MOST_W = math.radians(0.6), math.radians(3.0)
_TURNING = math.radians(1.0)
"""A mean rate so far from that of the other rests is a slow turn."""
_LEAN = math.radians(1.0)
"""Within a rest the vertical moves by less; a rest that creeps on is several."""
_TREMOR_S = 0.1
"""Over which a hand's tremor is correlated."""
_LEAST_STD = 2e-4
"""Of a rest's mean, as a share of gravity: what the chip's own bias wanders meanwhile."""
FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
_FACE = math.cos(math.radians(30.0))


@dataclass(frozen=True)
class Rest:
    """One rest: mean specific force sf (3,) and rate w (3,) as logged, with the deviation of each mean on an axis; the
    samples' range in log number `log`."""

    log: int
    first: int
    last: int
    sf: FloatArray
    w: FloatArray
    sf_std: float
    w_std: float
    temperature_degC: float
    seconds: float


def find_rests(logs: Sequence[ImuLog]) -> list[Rest]:
    """Return all rests of a second and more, in order."""
    return [rest for number, log in enumerate(logs) for rest in _rests_of(number, log)]


def _rests_of(number: int, log: ImuLog) -> list[Rest]:
    size = max(4, round(WINDOW_S * log.rate_hz))
    count = len(log.t_s) // size
    if count < 2:
        return []
    sf, w = (values[: count * size].reshape(count, size, 3) for values in (log.sf, log.w))
    length = float(np.median(np.linalg.norm(log.sf, axis=1))) + 1e-12
    still = _still(sf / length, w, log)
    quiet = np.flatnonzero(still)
    if len(quiet) == 0:
        return []
    means = sf.mean(axis=1)
    found, start = list[Rest](), 0
    for is_still, group in groupby(range(count), key=lambda window: bool(still[window])):
        windows = list(group)
        if not is_still:
            continue
        start = windows[0]
        for window in [*windows[1:], windows[-1] + 1]:
            over = window > windows[-1]
            if over or _angle(means[start:window].mean(axis=0), means[window]) > _LEAN:
                if (window - start) * WINDOW_S >= LEAST_REST_S:
                    found.append(_rest(number, log, start * size, window * size))
                start = window
    return found


def _still(sf: FloatArray, w: FloatArray, log: ImuLog) -> BoolArray:
    """Return which windows (k, m, 3), specific force in units of gravity, rest."""
    sf_scatter, w_scatter = sf.std(axis=1).max(axis=1), w.std(axis=1).max(axis=1)
    floor = float(np.percentile(sf_scatter, 5.0))
    still: BoolArray = sf_scatter < min(_MOST_SF, max(_QUIET_SF, _QUIET_TIMES * floor))
    if log.gyro_is_scaled:
        floor = float(np.percentile(w_scatter, 5.0))
        still &= w_scatter < min(_MOST_W, max(_QUIET_W, _QUIET_TIMES * floor))
        if still.any():
            mean = w.mean(axis=1)
            still &= np.linalg.norm(mean - np.median(mean[still], axis=0), axis=1) < _TURNING
    elif w.any():
        floor = float(np.percentile(w_scatter, 5.0))
        still &= w_scatter < _QUIET_TIMES * max(floor, 1e-12)
    return still


def _rest(number: int, log: ImuLog, first: int, last: int) -> Rest:
    sf, w = log.sf[first:last], log.w[first:last]
    seconds = (last - first) / log.rate_hz
    length = float(np.linalg.norm(sf.mean(axis=0)))
    shrinks = math.sqrt(min(1.0, max(_TREMOR_S, 1.0 / log.rate_hz) / seconds))
    return Rest(
        log=number,
        first=first,
        last=last,
        sf=sf.mean(axis=0),
        w=w.mean(axis=0),
        sf_std=math.hypot(float(sf.std(axis=0).max()) * shrinks, _LEAST_STD * length),
        w_std=float(w.std(axis=0).max()) * shrinks,
        temperature_degC=float(log.temperature_degC[first:last].mean()),
        seconds=seconds,
    )


def faces_of(directions: FloatArray) -> dict[str, int]:
    """Return how many of the directions (n, 3), of length 1, are within 30° of each axis, either way."""
    axes = np.repeat(np.eye(3), 2, axis=0) * np.tile((1.0, -1.0), 3)[:, None]
    counts = (directions.reshape(-1, 3) @ axes.T > _FACE).sum(axis=0)
    return dict(zip(FACES, counts.tolist(), strict=True))


def _angle(a: FloatArray, b: FloatArray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
