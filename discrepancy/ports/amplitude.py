"""What may be wrong with the values of a signal: gain, zero, curve, limits, steps, play, hum, a share of another one.

On outputs and inputs alike: `signals` are (k, n).
"""

import math
from functools import partial

import numpy as np
from scipy import fft

from discrepancy.ports.declared import Arrays, Rows, Side, SignalTerm
from discrepancy.ports.placed import on_signal
from discrepancy.ports.ranges import Span, Spans
from discrepancy.ports.sizes import SHARE
from discrepancy.simulation import Channels, Parameter
from messages.arrays import FloatArray

_LIMITS = (0.7, 0.9, 0.98)
"""Of the way from the middle to a signal's end: where a fit of a limit begins."""
_MOST_STEPS = 0.25
"""Of a channel's samples: with more values than that it is not rounded coarsely."""
_LINES = 3
"""Of what the base model leaves: the highest lines of its spectrum, where a fit of a tone begins."""
_PERIODS = 8
"""Of a tone in a recording: what repeats itself less often is no hum."""
_STATIC = "Hold the signal still at several values and compare it with a reference there."


def amplitude(side: Side, place: int, names: tuple[str, ...], spans: dict[str, Span], whole: Spans) -> list[SignalTerm]:
    """Return what may be wrong with the values of one signal, the `place`th of its side."""
    channel, unit = names[place], unit_of(names[place])
    term = partial(on_signal, side, channel)
    span = spans[channel]
    wide = span.high - span.low or 1.0

    def gain(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        return signals[place] * (1.0 + p["share"])

    def offset(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        return signals[place] + p["value"]

    def drift(signals: Rows, channels: Channels, p: Arrays) -> FloatArray:
        return np.asarray(signals[place] + p["rate"] * (channels.t_s - channels.t_s[0]))

    def curve(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        x = np.asarray(signals[place]) / span.size
        return (x + p["quadratic"] * x**2 + p["cubic"] * x**3) * span.size

    def play(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        x, half = np.asarray(signals[place]), 0.5 * p["width"][:, 0]
        out = np.empty_like(x)
        now = x[:, 0]
        for i in range(x.shape[1]):
            now = np.maximum(np.minimum(now, x[:, i] + half), x[:, i] - half)
            out[:, i] = now
        return out

    def dead_band(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        x = signals[place]
        return x - np.clip(x, -p["half_width"], p["half_width"])

    found = [
        term(
            "gain",
            gain,
            (Parameter("share", "1", 0.0, -0.9, 5.0, SHARE),),
            "Its scale is off by a share.",
            "Calibrate it, or correct the factor.",
            _STATIC,
        ),
        term(
            "offset",
            offset,
            (Parameter("value", unit, 0.0, -2.0 * wide, 2.0 * wide, SHARE * wide),),
            "Its zero is off.",
            "Tare it at a known zero.",
            _STATIC,
        ),
        term(
            "curve",
            curve,
            tuple(Parameter(name, "1", 0.0, -1.0, 1.0, SHARE) for name in ("quadratic", "cubic")),
            "It is not straight: a share of its square or cube, at its size in this recording, is added.",
            "Calibrate it at more than two points.",
            _STATIC,
            choices=(("quadratic",), ("cubic",), ("quadratic", "cubic")),
        ),
        term(
            "play",
            play,
            (Parameter("width", unit, 0.0, 0.0, 0.5 * wide, SHARE * wide),),
            "It has play: after each reversal it stands still before it follows. The whole width is told.",
            "Tighten gear, coupling or mounting.",
            "Go slowly up and down: play leaves a loop whose width does not depend on speed.",
        ),
        _saturation(side, place, channel, span),
    ]
    if side == "input":
        found += [
            term(
                "dead_band",
                dead_band,
                (Parameter("half_width", unit, 0.0, 0.0, 0.5 * span.size, SHARE * span.size),),
                "Small inputs do nothing.",
                "Add the dead band to the model, or its inverse to the input.",
                _STATIC,
            )
        ]
    else:
        rate = SHARE * wide / whole.seconds
        found += [
            term(
                "drift",
                drift,
                (Parameter("rate", f"{unit}/s", 0.0, -400.0 * rate, 400.0 * rate, rate),),
                "Its zero drifts with time.",
                "Let it warm up, and tare before and after.",
                "Record at rest for long.",
            ),
            *_tone(place, channel, wide, whole),
        ]
    return found + _coupled(side, place, names, spans)


def unit_of(channel: str) -> str:
    """Return the unit that stands behind the last underscore of a channel's name, "1" where none does."""
    return channel.rpartition("_")[2] if "_" in channel else "1"


def rounded(place: int, names: tuple[str, ...], measured: FloatArray) -> list[SignalTerm]:
    """Return coarse steps, where a measured channel (n,) has only few values, all multiples of one step."""
    values = np.unique(measured[np.isfinite(measured)])
    if not 2 < len(values) < _MOST_STEPS * len(measured):
        return []
    channel, step = names[place], float(np.median(np.diff(values)))

    def quantised(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        width = np.where(p["step"] > 0.0, p["step"], 1.0)
        out: FloatArray = np.where(p["step"] > 0.0, np.round(signals[place] / width) * width, signals[place])
        return out

    return [
        on_signal(
            "output",
            channel,
            "quantisation",
            quantised,
            (Parameter("step", unit_of(channel), 0.0, 0.0, 5.0 * step, 0.02 * step),),
            "It is rounded to coarse steps.",
            "Use a finer converter or a smaller range.",
            "List the values that it takes: they are multiples of one step.",
            starts=({"step": step},),
        )
    ]


def _saturation(side: Side, place: int, channel: str, span: Span) -> SignalTerm:
    middle, half = 0.5 * (span.high + span.low), 0.5 * (span.high - span.low) or 1.0

    def saturated(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        return np.clip(signals[place], p["lower"], p["upper"])

    unit = unit_of(channel)
    return on_signal(
        side,
        channel,
        "saturation",
        saturated,
        (
            Parameter("upper", unit, math.inf, middle, middle + 1.2 * half, SHARE * half, own_bounds=True),
            Parameter("lower", unit, -math.inf, middle - 1.2 * half, middle, SHARE * half, own_bounds=True),
        ),
        "It is cut off at a limit.",
        "Choose a larger range, or smaller motion.",
        "Repeat with half the amplitude: nothing is cut off then.",
        choices=(("upper",), ("lower",), ("upper", "lower")),
        starts=tuple({"upper": middle + share * half, "lower": middle - share * half} for share in _LIMITS),
    )


def _tone(place: int, channel: str, wide: float, whole: Spans) -> list[SignalTerm]:
    left = whole.left[channel]
    spectrum = np.abs(fft.rfft((left - left.mean()) * np.hanning(len(left))))
    f_hz = fft.rfftfreq(len(left), whole.step_s)
    peaks = 1 + np.flatnonzero((spectrum[1:-1] > spectrum[:-2]) & (spectrum[1:-1] > spectrum[2:]))
    peaks = np.array([each for each in peaks if each >= _PERIODS and each not in whole.lines], dtype=np.intp)
    highest = peaks[np.argsort(-spectrum[peaks])[:_LINES]]
    if not len(highest):
        return []

    def tone(signals: Rows, channels: Channels, p: Arrays) -> FloatArray:
        phase = 2.0 * np.pi * p["hz"] * (channels.t_s - channels.t_s[0])
        return np.asarray(signals[place] + p["sine"] * np.sin(phase) + p["cosine"] * np.cos(phase))

    unit, lowest_hz = unit_of(channel), float(f_hz[_PERIODS - 1])
    return [
        on_signal(
            "output",
            channel,
            "tone",
            tone,
            (
                *(Parameter(name, unit, 0.0, -wide, wide, 0.2 * SHARE * wide) for name in ("sine", "cosine")),
                Parameter("hz", "Hz", float(f_hz[highest[0]]), lowest_hz, float(f_hz[-1]), 0.05 / whole.seconds),
            ),
            "A hum of one frequency is added, whatever the inputs do.",
            "Look for the mains, a fan or another machine; shield or filter it.",
            "Record with all inputs off: the hum stays.",
            starts=tuple({"hz": float(f_hz[each])} for each in highest),
        )
    ]


def _coupled(side: Side, place: int, names: tuple[str, ...], spans: dict[str, Span]) -> list[SignalTerm]:
    others = [k for k in range(len(names)) if k != place]
    if not others:
        return []
    own = spans[names[place]].size

    def coupled(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
        out = np.array(signals[place])
        for k in others:
            out += p[f"from_{names[k]}"] * signals[k]
        return out

    parameters = []
    for k in others:
        most = own / spans[names[k]].size
        unit = f"{unit_of(names[place])}/{unit_of(names[k])}"
        parameters.append(Parameter(f"from_{names[k]}", unit, 0.0, -most, most, SHARE * most))
    return [
        on_signal(
            side,
            names[place],
            "cross_coupling",
            coupled,
            tuple(parameters),
            "It shows a share of another channel.",
            "Align the axes, or take the share off.",
            "Move one channel at a time.",
            choices=tuple((p.name,) for p in parameters),
        )
    ]
