"""The report's drawings: residuals over time and over frequency, before and after."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.explanation import View
from messages.arrays import FloatArray
from reports.drawing import AFTER, BEFORE, FLOOR, INK, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_CHANNELS = 8
"""In a figure: more rows do not fit a page."""
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


def shown_channels(view: View) -> list[int]:
    """Return the channels worth showing: those whose base residual stands out of the noise most, in their own order.

    Where none does, all may be shown.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        over = np.nan_to_num(np.nansum(view.spectrum.before, axis=0) / np.nansum(view.spectrum.noise, axis=0))
    most = np.argsort(-over, kind="stable")[:_MOST_CHANNELS].tolist()
    return sorted([channel for channel in most if over[channel] > _STANDS_OUT] or most)


def residuals_drawn(view: View) -> list[str]:
    """Return the residuals over time, base model behind, extended model before it, a drawing for each channel."""
    return [
        drawing(f"residual of {_named(view, channel)}", partial(_residual, view, channel), 1.5)
        for channel in shown_channels(view)
    ]


def spectra_drawn(view: View) -> list[str]:
    """Return the residuals' spectra before and after, over the noise floor, a drawing for each channel."""
    return [
        drawing(f"spectrum of {_named(view, channel)}", partial(_spectrum, view, channel))
        for channel in shown_channels(view)
    ]


def _named(view: View, channel: int) -> str:
    return view.channels.names[channel]


def _residual(view: View, channel: int, axes: "Axes") -> None:
    name, unit = channel_name(_named(view, channel))
    for residual, colour in ((view.residual_before, BEFORE), (view.residual_after, AFTER)):
        _draw_envelope(axes, view.channels.t_s, residual[:, channel], colour)
    axes.set(title=name, ylabel=unit, xlabel="s")
    axes.margins(x=0.0)
    axes.axhline(0.0, color=INK, linewidth=0.4)


def _spectrum(view: View, channel: int, axes: "Axes") -> None:
    spectrum = view.spectrum
    seen = spectrum.f_hz > 0.0
    name, unit = channel_name(_named(view, channel))
    noise = spectrum.noise[seen, channel]
    axes.fill_between(spectrum.f_hz[seen], noise, np.fmin.reduce(noise) / _SHADE_DEPTH, color=FLOOR, alpha=0.25, lw=0)
    for density, colour in ((spectrum.before, BEFORE), (spectrum.after, AFTER)):
        axes.plot(spectrum.f_hz[seen], density[seen, channel], color=colour, linewidth=1.1)
    axes.set(xscale="log", yscale="log", title=name, ylabel=f"({unit})²/Hz" if unit else "1/Hz", xlabel="Hz")
    axes.margins(x=0.0)
    densities = [density[seen, channel] for density in (spectrum.before, spectrum.after, spectrum.noise)]
    positive = np.concatenate([density[density > 0.0] for density in densities])
    if len(positive):
        axes.set_ylim(bottom=_BELOW_LOWEST * float(np.percentile(positive, _LOWEST_SHOWN)))


def channel_name(name: str) -> tuple[str, str]:
    """Return a channel's name in words and its unit, which is the name's last part: ("fx", "N")."""
    stem, _, suffix = name.rpartition("_")
    units = {
        "n": "N",
        "nm": "N·m",
        "m": "m",
        "mm": "mm",
        "rad": "rad",
        "radps": "rad/s",
        "mps": "m/s",
        "mps2": "m/s²",
        "px": "px",
        "deg": "°",
    }
    return (stem.replace("_", " "), units[suffix]) if stem and suffix in units else (name.replace("_", " "), "")


def _draw_envelope(axes: "Axes", t_s: FloatArray, values: FloatArray, colour: str) -> None:
    """Draw each sample, or, of more than a line can show, the range within each of some hundred spans of time."""
    if len(t_s) <= 2 * _BINS:
        axes.plot(t_s, values, color=colour, linewidth=0.8)
        return
    starts = np.linspace(0, len(t_s), _BINS, endpoint=False).astype(int)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    axes.fill_between(t_s[starts], low, high, color=colour, linewidth=0.4)
