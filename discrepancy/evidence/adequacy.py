"""Whether a model is adequate: what of its residual follows from the inputs, a line, or more than the known noise."""

from dataclasses import replace

import numpy as np
from scipy import fft
from scipy.special import gammaincinv

from discrepancy.evidence.probe import Predictable, Probe
from discrepancy.evidence.spectral_lines import strongest_line
from discrepancy.evidence.whitening import Whitening
from discrepancy.explanation import Adequacy
from discrepancy.problem import Problem
from messages.arrays import FloatArray

_STRETCHES = 40
"""Of the recording, over which the noise's level is held against the inputs'."""
_MATERIAL = 0.01
"""Of the noise's power: what is predictable below that is the model's own numerical error."""
_PLAIN = 0.05
"""Likewise: what is predictable above that needs no second recording to be believed."""
_CHANCE_ELSEWHERE = 0.1
"""Likewise, on another recording, where what little was found here has only to be confirmed."""
LEVEL = 1.3
"""Times the declared noise: what is left above that is no noise."""
_LEVEL_CHANCE = 0.001
"""Of noise being louder than that in any channel: a right model must hardly ever be refused for it."""
_WHITENESS_LAGS = 64
"""Samples: twice the single lags that the whitening takes away, so that what it cannot reach shows."""


def adequacy(
    problem: Problem, white: Whitening, probe: Probe, residual: FloatArray, elsewhere: float
) -> tuple[Adequacy, Predictable]:
    """Return whether a model with this raw `residual` (c, n) is adequate, and what of it the inputs predict.

    `elsewhere` is the chance of what the inputs predict of the same model's residual on another recording: little is
    believed only if it is missing there too.
    """
    found = probe.predictable(residual)
    own = white(residual)
    count = np.maximum(white.kept.sum(axis=1), 1)
    unit = own / np.sqrt(np.maximum((own**2).sum(axis=1) / count, np.finfo(float).tiny))[:, None]
    rms = np.sqrt((residual**2 * problem.valid).sum(axis=1) / np.maximum(problem.valid.sum(axis=1), 1))
    known = problem.channels.noise_std
    level = rms / known if known is not None else np.full(problem.c, np.nan)
    most = LEVEL * _level_by_chance(problem, white)
    reasons = []
    if found.groups and float(found.share.max()) >= (_MATERIAL if elsewhere <= _CHANCE_ELSEWHERE else _PLAIN):
        where, told = problem.channels.names[int(np.argmax(found.share))], ", ".join(found.groups)
        reasons.append(f"{100.0 * float(found.share.max()):.1f} % of what is left in {where} follows from {told}")
    line = strongest_line(residual)
    if line is not None:
        name, hz = problem.channels.names[line.row], line.bin * problem.rate_hz / problem.n
        reasons.append(f"{name}: a line at {hz:.2f} Hz holds {100.0 * line.share:.0f} %")
        found = replace(found, signal=found.signal + line.signal)
    if np.any(level > most):
        row = int(np.nanargmax(level / most))
        reasons.append(f"{problem.channels.names[row]}: {level[row]:.2f} times the declared noise is left")
    return (
        Adequacy(
            adequate=not reasons,
            chance=found.chance,
            predictable=found.share,
            level=level,
            whiteness=_whiteness(unit),
            heteroscedasticity=_heteroscedasticity(problem, unit),
            reasons=tuple(reasons),
        ),
        found,
    )


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
