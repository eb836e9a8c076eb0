"""What may be wrong with the times of a signal: a delay, a lag, a clock that drifts, a slow update, lost samples.

On outputs and inputs alike: `signals` are (k, n), and what is told is positive where the real signal is late. An input
that is held from sample to sample acts by its mean over each; an output goes straight from one to the next, or bends.
"""

import math
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from discrepancy.ports.declared import Arrays, Rows, Side, SignalTerm
from discrepancy.ports.placed import on_signal
from discrepancy.ports.ranges import Span, Spans
from discrepancy.ports.sizes import SHARE
from discrepancy.simulation import Channels, Parameter
from messages.arrays import FloatArray

_MOST_OF_RECORD = 0.05
"""Of a recording's length: a longer delay would leave its ends without a comparison."""
_LEAST_STEPS = 0.02
"""Samples: a shorter delay is of no matter, whatever moves."""
_REPEATS = 0.01
"""Of a channel's samples: fewer equal neighbours are chance."""
_SLOWER = (2.0, 3.0, 5.0, 10.0)
"""Times that a channel may be updated more slowly than it is written."""
_FINER = 4
"""Straight pieces to a sample, of what bends between two."""
_SHIFTS = (-1, 1)
"""Samples that a delay may begin at: of a signal that jumps, a shift by a part of one is a minimum of its own."""
_STEPWISE = "Step an input and compare when the channels begin to move, and how fast."


def timing(side: Side, place: int, names: tuple[str, ...], span: Span, whole: Spans) -> list[SignalTerm]:
    """Return what may be wrong with the times of one signal, the `place`th of its side."""
    term = partial(on_signal, side, names[place])
    step_s = whole.step_s
    longest = _MOST_OF_RECORD * whole.seconds
    shift = SHARE * (span.high - span.low) * step_s / span.jump if span.jump > 0.0 else step_s
    scale = float(np.clip(shift, _LEAST_STEPS * step_s, 0.1 * longest))
    between = smoothly_at_times if side == "output" and names[place] in whole.bent else at_times
    followed = _mean_followed if side == "input" and whole.held else _followed
    if between is smoothly_at_times:
        followed = _smoothly_followed

    def delay(signals: Rows, channels: Channels, p: Arrays) -> FloatArray:
        return between(channels.t_s - p["value"], channels.t_s, signals[place])

    def clock(signals: Rows, channels: Channels, p: Arrays) -> FloatArray:
        t_s = channels.t_s
        return between(t_s - p["rate"] * (t_s - t_s[0]), t_s, signals[place])

    def lag(signals: Rows, channels: Channels, p: Arrays) -> FloatArray:
        out = np.array(signals[place])
        for row, tau in zip(out, np.ravel(p["value"]), strict=True):
            if tau > 0.0:
                row[:] = followed(row, 1.0 / (channels.rate_hz * tau))
        return out

    def slow(signals: Rows, channels: Channels, p: Arrays) -> FloatArray:
        t_s, f = channels.t_s - channels.t_s[0], p["update_hz"]
        with np.errstate(invalid="ignore"):
            held = np.where(np.isfinite(f), np.floor(t_s * f + 1e-9) / f, t_s)
        return at_times(held, t_s, signals[place])

    found = [
        term(
            "delay",
            delay,
            (Parameter("value", "s", 0.0, -longest, longest, scale),),
            "It comes late.",
            "Subtract the delay from its stamps, or model it.",
            _STEPWISE,
            starts=({}, *({"value": k * step_s} for k in _SHIFTS)) if whole.jumps and step_s < longest else (),
        ),
        term(
            "lag",
            lag,
            (Parameter("value", "s", 0.0, 0.0, longest, scale),),
            "It is smoothed, as by a filter or a slow sensor or actuator: it follows with a time constant.",
            "Put the filter into the model, or switch it off.",
            _STEPWISE,
        ),
    ]
    if side == "output":
        slowest, fastest = 5.0 / whole.seconds, 1.0 / step_s
        found += [
            term(
                "clock_drift",
                clock,
                (Parameter("rate", "s/s", 0.0, -_MOST_OF_RECORD, _MOST_OF_RECORD, scale / whole.seconds),),
                "Its clock runs slow against that of the inputs: it is the later the longer the recording.",
                "Stamp both with one clock.",
                "Give the same blow at the beginning and at the end, and compare their times.",
            ),
            term(
                "aliasing",
                slow,
                (Parameter("update_hz", "Hz", math.inf, slowest, fastest, 1e-3 / step_s, own_bounds=True),),
                "It is sampled at a slower clock, without a filter before, and held between.",
                "Read it as fast as it is written, or put a filter before its sampler.",
                "List its values: they stand still and then jump, at a rate of their own.",
                starts=tuple({"update_hz": 1.0 / (step_s * times)} for times in _SLOWER),
            ),
        ]
    return found


def lost(place: int, names: tuple[str, ...], measured: FloatArray) -> list[SignalTerm]:
    """Return lost samples, written again in their place, where a measured channel (n,) has equal neighbours."""
    if float(np.mean(repeated(measured))) < _REPEATS:
        return []
    channel = names[place]

    def dropped(signals: Rows, channels: Channels, p: Arrays) -> FloatArray:
        again = repeated(channels.values[:, place])
        fresh = np.maximum.accumulate(np.where(again, 0, np.arange(len(again))))
        signal = np.asarray(signals[place])
        return np.asarray(signal + p["held"] * (signal[:, fresh] - signal))

    return [
        on_signal(
            "output",
            channel,
            "dropped_samples",
            dropped,
            (Parameter("held", "1", 0.0, 0.0, 1.5, 0.02),),
            "Samples are lost, and the last one is written again in their place.",
            "Record over a faster link, or mark lost samples as missing.",
            "Count equal neighbours in a recording with noise: none may be equal to the one before.",
        )
    ]


def repeated(measured: FloatArray) -> FloatArray:
    """Return which samples (n,) equal the one before while the signal moves."""
    return np.concatenate(([False], np.diff(measured) == 0.0))


def at_times(wanted: FloatArray, t_s: FloatArray, signals: FloatArray) -> FloatArray:
    """Return signals (k, n) at times (k, n), on straight lines between samples and held beyond the ends.

    Of a signal that is held from sample to sample that is the mean over the sample that begins at each time.
    """
    times = np.broadcast_to(wanted, signals.shape)
    return np.stack([np.interp(when, t_s, row) for when, row in zip(times, signals, strict=True)])


def smoothly_at_times(wanted: FloatArray, t_s: FloatArray, signals: FloatArray) -> FloatArray:
    """Return signals (k, n) at times (k, n), on cubic splines between samples and held beyond the ends; on straight
    lines where a signal is not finite.
    """
    times = np.clip(np.broadcast_to(wanted, signals.shape), t_s[0], t_s[-1])
    rows = zip(times, signals, strict=True)
    return np.stack(
        [CubicSpline(t_s, row)(when) if np.isfinite(row).all() else np.interp(when, t_s, row) for when, row in rows]
    )


def _followed(x: FloatArray, step: float) -> FloatArray:
    """Return what follows x (n,), straight lines between samples that are `step` time constants apart:

    y' = y e^{-s} + (1 − g) x' + (g − e^{-s}) x,   g = (1 − e^{-s}) / s                                           (1)
    """
    kept = math.exp(-step)
    g = -math.expm1(-step) / step
    return np.asarray(lfilter([1.0 - g, g - kept], [1.0, -kept], x, zi=[g * x[0]])[0])


def _smoothly_followed(x: FloatArray, step: float) -> FloatArray:
    """Return what follows x (n,), cubic splines between samples that are `step` time constants apart."""
    if not np.isfinite(x).all():
        return _followed(x, step)
    places = np.arange(_FINER * (len(x) - 1) + 1) / _FINER
    return _followed(CubicSpline(np.arange(len(x)), x)(places), step / _FINER)[::_FINER]


def _mean_followed(x: FloatArray, step: float) -> FloatArray:
    """Return the mean over each sample of what follows x (n,), held for samples of `step` time constants."""
    kept = math.exp(-step)
    begun = lfilter([0.0, 1.0 - kept], [1.0, -kept], x, zi=[x[0]])[0]
    return np.asarray(x + (begun - x) * (-math.expm1(-step) / step))
