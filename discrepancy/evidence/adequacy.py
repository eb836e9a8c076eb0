"""Whether a model is adequate: what of its residual follows from the inputs, a line, or more than the known noise."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.special import gammaincinv

from discrepancy.evidence.probe import Predictable, Probe
from discrepancy.evidence.spectral_lines import FAINT_SHARE, SHARE, Line, strongest_line
from discrepancy.evidence.whitening import Whitening
from discrepancy.explanation import Adequacy
from discrepancy.problem import Problem
from messages.arrays import BoolArray, FloatArray

_STRETCHES = 40
"""Of the recording, over which the noise's level is held against the inputs'."""
_MATERIAL = 0.01
"""Of the noise's power: what is predictable below that is the model's own numerical error."""
_PLAIN = 0.05
"""Likewise: what is predictable above that needs no second recording to be believed."""
_CHANCE_ELSEWHERE = 0.1
"""Likewise, on another recording, where what little was found here has only to be confirmed."""
LEVEL = 1.3
"""Times the known noise: what is left above that is no noise."""
_LEVEL_AT_REST = 2.0
"""Times the noise at rest: what is left above that may be noise that motion makes, or not."""
_GROWN = 2.0
"""Times what a model leaves where it was fitted: with its noise unknown, what it leaves above that is no noise."""
_LEVEL_CHANCE = 0.001
"""Of noise being louder than that in any channel: a right model must hardly ever be refused for it."""
_WHITENESS_LAGS = 64
"""Samples: twice the single lags that the whitening takes away, so that what it cannot reach shows."""


@dataclass(frozen=True)
class Left:
    """What a model leaves of one recording: its raw `residual` (c, n), what of that is `predictable`, under which
    `white` noise, and the strongest `line`, which may be faint.
    """

    problem: Problem
    white: Whitening
    residual: FloatArray
    predictable: Predictable
    line: Line | None

    @property
    def channel_rms(self) -> FloatArray:
        """Return the residual's root mean square (c,)."""
        valid = self.problem.valid
        power = (self.residual**2 * valid).sum(axis=1) / np.maximum(valid.sum(axis=1), 1)
        return np.asarray(np.sqrt(power), dtype=np.float64)

    @property
    def good_enough(self) -> BoolArray:
        """Return which channels (c,) are within the tolerance that was stated."""
        tolerance = self.problem.channels.tolerance
        return np.zeros(self.problem.c, bool) if tolerance is None else np.asarray(self.channel_rms <= tolerance)

    def line_hz(self) -> float:
        """Return the line's frequency, NaN without one."""
        return np.nan if self.line is None else self.line.bin * self.problem.rate_hz / self.problem.n


def left(problem: Problem, white: Whitening, probe: Probe, residual: FloatArray) -> Left:
    """Return what a model with this raw `residual` (c, n) leaves."""
    return Left(problem, white, residual, probe.predictable(residual), strongest_line(residual, FAINT_SHARE))


def adequacy(here: Left, elsewhere: Left | None) -> tuple[Adequacy, Predictable]:
    """Return whether a model is adequate by what it leaves `here`, and what of it the inputs predict, lines included.

    Little that is predictable, and a faint line, are believed only if what the same model leaves `elsewhere`, on
    another recording, shows them too. A faint line is remarked and condemns no model: a sensor's noise may hold it.
    """
    problem, white, residual, found = here.problem, here.white, here.residual, here.predictable
    own = white(residual)
    count = np.maximum(white.kept.sum(axis=1), 1)
    unit = own / np.sqrt(np.maximum((own**2).sum(axis=1) / count, np.finfo(float).tiny))[:, None]
    known = problem.noise
    level = here.channel_rms / known.std if known is not None else np.full(problem.c, np.nan)
    by_chance = _level_by_chance(problem, white)
    counts = ~here.good_enough
    share = np.where(counts, found.share, 0.0)
    confirmed = elsewhere is not None and elsewhere.predictable.chance <= _CHANCE_ELSEWHERE
    reasons: list[str] = []
    doubts: list[str] = []
    remarks: list[str] = []
    if found.groups and float(share.max()) >= (_MATERIAL if confirmed else _PLAIN):
        where, told = problem.channels.names[int(np.argmax(share))], ", ".join(found.groups)
        reasons.append(f"{100.0 * float(share.max()):.1f} % of what is left in {where} follows from {told}")
    line = here.line
    if line is not None and counts[line.row]:
        told = f"{problem.channels.names[line.row]}: a line at {here.line_hz():.2f} Hz holds {100.0 * line.share:.0f} %"
        if line.share >= SHARE:
            reasons.append(told)
            found = replace(found, signal=found.signal + line.signal)
        elif _same_line(here, elsewhere):
            remarks.append(f"{told} of what is left, on both recordings")
    if known is not None:
        over = np.where(counts, level / by_chance, 0.0)
        row = int(np.argmax(over))
        name, times = problem.channels.names[row], f"{level[row]:.2f} times the noise"
        if known.whole and over[row] > LEVEL:
            words = "the declared noise" if known.source == "stated" else f"the noise, told by {known.source}"
            reasons.append(f"{name}: {level[row]:.2f} times {words} is left")
        elif not known.whole and over[row] > _LEVEL_AT_REST:
            doubts.append(f"{name}: {times} at rest is left, and nothing shows what it follows from")
    return (
        Adequacy(
            adequate=not reasons,
            chance=found.chance,
            predictable=found.share,
            level=level,
            whiteness=_whiteness(unit),
            heteroscedasticity=_heteroscedasticity(problem, unit),
            reasons=tuple(reasons),
            doubts=tuple(doubts),
            remarks=tuple(remarks),
        ),
        found,
    )


def grown(here: Left, elsewhere: Left) -> str | None:
    """Return in words where a frozen model leaves far more `elsewhere` than `here`, where it was fitted.

    A noise that is known judges each recording by itself.
    """
    if here.problem.noise is not None or not np.all(here.channel_rms > 0.0):
        return None
    chance = _level_by_chance(elsewhere.problem, elsewhere.white) * _level_by_chance(here.problem, here.white)
    times = np.where(elsewhere.good_enough, 0.0, elsewhere.channel_rms / here.channel_rms)
    row = int(np.argmax(times / chance))
    if times[row] <= _GROWN * chance[row]:
        return None
    return f"{here.problem.channels.names[row]}: {times[row]:.1f} times what the fitted recording leaves"


def _same_line(here: Left, elsewhere: Left | None) -> bool:
    """Return whether a line is in the same channel at the same frequency elsewhere, to a bin of either record."""
    if elsewhere is None or here.line is None or elsewhere.line is None or here.line.row != elsewhere.line.row:
        return False
    bin_hz = sum(each.problem.rate_hz / each.problem.n for each in (here, elsewhere))
    return bool(abs(here.line_hz() - elsewhere.line_hz()) <= bin_hz)


def _level_by_chance(problem: Problem, white: Whitening) -> FloatArray:
    """Return by how much the level (c,) of noise as coloured as this may exceed the declared one, in one recording of a
    thousand.

    The mean square of n samples with the power density S is about χ² with n (∫ S)² / ∫ S² degrees of freedom: the
    slower the noise, the fewer.
    """
    density = 1.0 / np.maximum(np.abs(white.response) ** 2, np.finfo(float).tiny)
    count = problem.valid.sum(axis=1)
    freedom = np.maximum(count * density.mean(axis=1) ** 2 / (density**2).mean(axis=1), 1.0)
    return np.asarray(
        np.sqrt(2.0 / freedom * gammaincinv(0.5 * freedom, 1.0 - _LEVEL_CHANCE / problem.c)), dtype=np.float64
    )


def _whiteness(unit: FloatArray) -> FloatArray:
    """Return the largest autocorrelation (c,) of rows (c, n) at lags up to `_WHITENESS_LAGS`."""
    power = np.abs(fft.rfft(unit, 2 * unit.shape[1], axis=1)) ** 2
    correlation = fft.irfft(power, axis=1)[:, 1 : _WHITENESS_LAGS + 1] / unit.shape[1]
    return np.asarray(np.abs(correlation).max(axis=1), dtype=np.float64)


def _heteroscedasticity(problem: Problem, unit: FloatArray) -> FloatArray:
    """Return the correlation (c,) of the residual's square with the inputs' mean square, both over stretches."""
    inputs = np.nan_to_num(problem.channels.inputs.T)
    spread = inputs.std(axis=1)
    moving = inputs[spread > 0.0]
    if not len(moving):
        return np.zeros(problem.c)
    level = (((moving - moving.mean(axis=1, keepdims=True)) / spread[spread > 0.0][:, None]) ** 2).mean(axis=0)
    edges = np.linspace(0, problem.n, _STRETCHES + 1).astype(int)[:-1]
    width = problem.n / _STRETCHES
    of_level = np.add.reduceat(level, edges) / width
    of_noise = np.add.reduceat(unit**2, edges, axis=1) / width
    x = of_level - of_level.mean()
    y = of_noise - of_noise.mean(axis=1, keepdims=True)
    size = np.sqrt((x @ x) * np.sum(y**2, axis=1))
    return np.asarray(np.where(size > 0.0, y @ x / np.where(size > 0.0, size, 1.0), 0.0), dtype=np.float64)
