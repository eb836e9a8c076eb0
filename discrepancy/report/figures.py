"""The report's drawings: measured beside simulated, and residuals over time and over frequency, before and after."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.explanation import View
from discrepancy.report.wording import channel_name
from messages.arrays import FloatArray
from reports.drawing import AFTER, BEFORE, FLOOR, INK, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_CHANNELS = 8
"""In a figure: more rows do not fit a page."""
_MOST_COMPARED = 4
"""Channels that are shown measured beside simulated: two drawings each."""
_ZOOMED_SHARE, _LEAST_ZOOMED, _MOST_ZOOMED = 40, 40, 200
"""The share of a recording, and its samples, that are drawn dot by dot where they differ most."""
_LONG_BEFORE = 20.0
"""Recordings before its first sample from which on a clock's own seconds have more digits than a drawing shows."""
_LOW_IN = 1.5
"""Height of a drawing over time."""
_STANDS_OUT = 1.2
"""Times the noise's power: a base residual below it shows nothing."""
_BINS = 360
"""Spans of time in a row: each is between one and two points wide."""
_LOWEST_SHOWN = 5.0
"""Percent of a figure's densities that may lie below it, as at the edge of a filter's band."""
_BELOW_LOWEST = 0.3
"""Times that density: where a figure ends, half a decade lower."""
_SHADE_DEPTH = 10.0
"""By which the lowest noise is divided for the lower edge of its shading: it reaches below every line."""


def shown_channels(view: View, most: int = _MOST_CHANNELS) -> list[int]:
    """Return the channels worth showing: those whose base residual stands out of the noise most, in their own order.

    Where none does, all may be shown.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        over = np.nan_to_num(np.nansum(view.spectrum.before, axis=0) / np.nansum(view.spectrum.noise, axis=0))
    first = np.argsort(-over, kind="stable")[:most].tolist()
    return sorted([channel for channel in first if over[channel] > _STANDS_OUT] or first)


def compared_drawn(view: View, *, named: bool) -> list[str]:
    """Return measured beside simulated, two drawings for each of the channels that tell most: all of the recording, and
    the stretch of it where both differ most. The extended model is drawn where a cause was `named`.
    """
    drawn = []
    for channel in shown_channels(view, _MOST_COMPARED):
        name, zoom = _named(view, channel), worst_stretch(view, channel)
        drawn.append(drawing(f"all of {name}", partial(_whole, view, channel, zoom, named), _LOW_IN))
        drawn.append(drawing(f"zoom into {name}", partial(_zoomed, view, channel, zoom, named), _LOW_IN))
    return drawn


def residuals_drawn(view: View, *, named: bool) -> list[str]:
    """Return the residuals over time, base model behind, extended model before it, a drawing for each channel."""
    return [
        drawing(f"residual of {_named(view, channel)}", partial(_residual, view, channel, named), _LOW_IN)
        for channel in shown_channels(view)
    ]


def spectra_drawn(view: View, *, named: bool) -> list[str]:
    """Return the residuals' spectra before and after, over the noise floor, a drawing for each channel."""
    return [
        drawing(f"spectrum of {_named(view, channel)}", partial(_spectrum, view, channel, named))
        for channel in shown_channels(view)
    ]


def worst_stretch(view: View, channel: int) -> slice:
    """Return the samples, a fortieth of the recording or what a drawing can still show dot by dot, in which measured
    and base model differ most; what is missing counts as equal.
    """
    n = len(view.channels.t_s)
    length = min(max(n // _ZOOMED_SHARE, _LEAST_ZOOMED), _MOST_ZOOMED, n)
    power = np.nan_to_num(view.residual_before[:, channel]) ** 2
    running = np.concatenate(([0.0], np.cumsum(power)))
    first = int(np.argmax(running[length:] - running[:-length]))
    return slice(first, first + length)


def _named(view: View, channel: int) -> str:
    return view.channels.names[channel]


def _whole(view: View, channel: int, zoom: slice, named: bool, axes: "Axes") -> None:
    name, unit = channel_name(_named(view, channel))
    t_s, label = _times(view)
    _draw_envelope(axes, t_s, view.channels.values[:, channel], INK)
    for predicted, colour in _predictions(view, named):
        _draw_envelope(axes, t_s, predicted[:, channel], colour)
    axes.axvspan(t_s[zoom][0], t_s[zoom][-1], color=FLOOR, alpha=0.3, linewidth=0.0)
    axes.set(title=name, ylabel=unit, xlabel=label)
    axes.margins(x=0.0)


def _zoomed(view: View, channel: int, zoom: slice, named: bool, axes: "Axes") -> None:
    name, unit = channel_name(_named(view, channel))
    t_s, label = _times(view)
    axes.plot(t_s[zoom], view.channels.values[zoom, channel], ".", color=INK, markersize=3.0)
    for predicted, colour in _predictions(view, named):
        axes.plot(t_s[zoom], predicted[zoom, channel], color=colour, linewidth=1.1)
    axes.set(title=f"{name}, where they differ most", ylabel=unit, xlabel=label)
    axes.margins(x=0.0)


def _predictions(view: View, named: bool) -> list[tuple[FloatArray, str]]:
    return [(view.base, BEFORE), *([(view.extended, AFTER)] if named else [])]


def _times(view: View) -> tuple[FloatArray, str]:
    """Return the times to draw over and what they are: of a clock that began long before, seconds after a whole one."""
    t_s = view.channels.t_s
    first = float(np.floor(t_s[0]))
    if abs(first) < _LONG_BEFORE * float(t_s[-1] - t_s[0]):
        return t_s, "s"
    return t_s - first, f"s after {first:.0f} s"


def _residual(view: View, channel: int, named: bool, axes: "Axes") -> None:
    name, unit = channel_name(_named(view, channel))
    t_s, label = _times(view)
    for residual, colour in ((view.residual_before, BEFORE), *(((view.residual_after, AFTER),) if named else ())):
        _draw_envelope(axes, t_s, residual[:, channel], colour)
    axes.set(title=name, ylabel=unit, xlabel=label)
    axes.margins(x=0.0)
    axes.axhline(0.0, color=INK, linewidth=0.4)


def _spectrum(view: View, channel: int, named: bool, axes: "Axes") -> None:
    spectrum = view.spectrum
    seen = spectrum.f_hz > 0.0
    name, unit = channel_name(_named(view, channel))
    noise = spectrum.noise[seen, channel]
    axes.fill_between(spectrum.f_hz[seen], noise, np.fmin.reduce(noise) / _SHADE_DEPTH, color=FLOOR, alpha=0.25, lw=0)
    for density, colour in ((spectrum.before, BEFORE), *(((spectrum.after, AFTER),) if named else ())):
        axes.plot(spectrum.f_hz[seen], density[seen, channel], color=colour, linewidth=1.1)
    axes.set(xscale="log", yscale="log", title=name, ylabel=f"({unit})²/Hz" if unit else "1/Hz", xlabel="Hz")
    axes.margins(x=0.0)
    densities = [density[seen, channel] for density in (spectrum.before, spectrum.after, spectrum.noise)]
    positive = np.concatenate([density[density > 0.0] for density in densities])
    if len(positive):
        axes.set_ylim(bottom=_BELOW_LOWEST * float(np.percentile(positive, _LOWEST_SHOWN)))


def _draw_envelope(axes: "Axes", t_s: FloatArray, values: FloatArray, colour: str) -> None:
    """Draw each sample, or, of more than a line can show, the range within each of some hundred spans of time."""
    if len(t_s) <= 2 * _BINS:
        axes.plot(t_s, values, color=colour, linewidth=0.8)
        return
    starts = np.linspace(0, len(t_s), _BINS, endpoint=False).astype(int)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    axes.fill_between(t_s[starts], low, high, color=colour, linewidth=0.4)
