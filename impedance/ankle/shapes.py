"""Shapes over a trial's stance and time of which the ankle's curves are made: splines, hats, slow curves, lags."""

from typing import Final

import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from messages.arrays import FloatArray, IntArray

_DRIFT_KNOT_S: Final = 0.12


def spline(at: FloatArray, span: tuple[float, float], count: int) -> FloatArray:
    """Return `count` cubic B-splines with even knots over `span`, at (n,): (n, count), each row adding up to 1."""
    step = (span[1] - span[0]) / (count - 3)
    knots = span[0] + step * np.arange(-3, count + 1)
    shapes: FloatArray = BSpline.design_matrix(np.clip(at, knots[3], knots[-4]), knots, 3).toarray()
    return shapes


def line_and_bend(count: int) -> tuple[FloatArray, FloatArray]:
    """Return (count, 2) and (count, count − 2): coefficients of level and slope, and of unit second differences."""
    line = np.column_stack((np.ones(count), np.linspace(-1.0, 1.0, count)))
    second = np.diff(np.eye(count), n=2, axis=0)
    return line, second.T @ np.linalg.inv(second @ second.T)


def hats(s: FloatArray, span: tuple[float, float], count: int) -> FloatArray:
    """Return `count` linear hat functions over `span`, at (n,): (n, count), each row adding up to 1."""
    place = (s - span[0]) / (span[1] - span[0]) * (count - 1)
    shares: FloatArray = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(count)))
    return shares


def drift(t_s: FloatArray, cycle: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the columns of every cycle's slow curve: level and slope, and bends."""
    lines: list[FloatArray] = []
    bends: list[FloatArray] = []
    for c in np.unique(cycle):
        rows = np.flatnonzero(cycle == c)
        t = t_s[rows]
        count = max(4, 3 + round((t[-1] - t[0]) / _DRIFT_KNOT_S))
        shapes = spline(t, (t[0], t[-1]), count)
        line, bend = line_and_bend(count)
        for columns, part in ((lines, shapes @ line), (bends, shapes @ bend)):
            whole = np.zeros((len(t_s), part.shape[1]))
            whole[rows] = part
            columns.append(whole)
    return np.hstack(lines), np.hstack(bends)


def lagged(values: FloatArray, cycle: IntArray, rate_hz: float, lags_s: tuple[float, ...]) -> FloatArray:
    """Return (n, 2 lags): values (n,) through 1 / (1 + T p) and 1 / (1 + T p)², p = d/dt, every cycle from rest."""
    columns = np.zeros((len(values), 2 * len(lags_s)))
    for c in np.unique(cycle):
        rows = np.flatnonzero(cycle == c)
        for place, lag_s in enumerate(lags_s):
            keep = np.exp(-1.0 / (lag_s * rate_hz))
            once = lfilter([1.0 - keep], [1.0, -keep], values[rows])
            columns[rows, 2 * place] = once
            columns[rows, 2 * place + 1] = lfilter([1.0 - keep], [1.0, -keep], once)
    return columns
