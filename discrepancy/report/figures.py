"""The report's figures, as inline SVG: residuals over time and over frequency, before and after."""

import io
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.explanation import View
from messages.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER, FLOOR = "#c2622d", "#1f5a85", "#8a8f94"
_INK, _RULE = "#3c4146", "#d5d9dc"
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


def residuals_svg(view: View) -> str:
    """Return the residuals over time, base model behind, extended model before it, a row for each channel."""
    from matplotlib import rc_context

    shown = shown_channels(view)
    with rc_context(_style("residuals")):
        figure, rows = _sheet(len(shown), 1, 1.25)
        for axes, channel in zip(rows, shown, strict=True):
            name, unit = channel_name(view.channels.names[channel])
            for residual, colour in ((view.residual_before, BEFORE), (view.residual_after, AFTER)):
                _draw_envelope(axes, view.channels.t_s, residual[:, channel], colour)
            axes.set_title(name)
            axes.set_ylabel(unit)
            axes.margins(x=0.0)
            axes.axhline(0.0, color=_INK, linewidth=0.4)
        rows[-1].set_xlabel("s")
        return _svg(figure, "Residuals over time, before and after")


def spectra_svg(view: View) -> str:
    """Return the residuals' spectra before and after, over the noise floor."""
    from matplotlib import rc_context

    shown = shown_channels(view)
    spectrum = view.spectrum
    seen = spectrum.f_hz > 0.0
    with rc_context(_style("spectra")):
        figure, cells = _sheet(-(-len(shown) // 2), 2 if len(shown) > 1 else 1, 1.9)
        for axes, channel in zip(cells, shown, strict=False):
            name, unit = channel_name(view.channels.names[channel])
            noise = spectrum.noise[seen, channel]
            axes.fill_between(
                spectrum.f_hz[seen], noise, np.fmin.reduce(noise) / _SHADE_DEPTH, color=FLOOR, alpha=0.25, lw=0
            )
            for density, colour in ((spectrum.before, BEFORE), (spectrum.after, AFTER)):
                axes.plot(spectrum.f_hz[seen], density[seen, channel], color=colour, linewidth=1.1)
            axes.set(xscale="log", yscale="log", title=name, ylabel=f"({unit})²/Hz" if unit else "1/Hz")
            axes.margins(x=0.0)
            densities = [density[seen, channel] for density in (spectrum.before, spectrum.after, spectrum.noise)]
            positive = np.concatenate([density[density > 0.0] for density in densities])
            if len(positive):
                axes.set_ylim(bottom=_BELOW_LOWEST * float(np.percentile(positive, _LOWEST_SHOWN)))
        for axes in cells[len(shown) :]:
            axes.remove()
        for axes in cells[max(0, len(shown) - 2) : len(shown)]:
            axes.set_xlabel("Hz")
        return _svg(figure, "Spectra of the residuals, before and after, over the noise")


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


def _style(drawing: str) -> Any:
    """Return matplotlib's settings; the names inside two drawings must not meet on one page."""
    style: Any = {  # too many keys to be typed
        "svg.fonttype": "none",
        "font.size": 9.0,
        "axes.edgecolor": _RULE,
        "axes.labelcolor": _INK,
        "axes.titlecolor": _INK,
        "axes.titlesize": 9.5,
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "xtick.color": _INK,
        "ytick.color": _INK,
        "xtick.major.size": 3.0,
        "ytick.major.size": 3.0,
        "text.color": _INK,
        "svg.hashsalt": drawing,
    }
    return style


def _sheet(rows: int, columns: int, height_in: float) -> "tuple[Figure, list[Axes]]":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, height_in * rows + 0.5), layout="constrained")
    cells = figure.subplots(rows, columns, sharex=True, squeeze=False)
    return figure, list(cells.ravel())


def _draw_envelope(axes: "Axes", t_s: FloatArray, values: FloatArray, colour: str) -> None:
    """Draw each sample, or, of more than a line can show, the range within each of some hundred spans of time."""
    if len(t_s) <= 2 * _BINS:
        axes.plot(t_s, values, color=colour, linewidth=0.8)
        return
    starts = np.linspace(0, len(t_s), _BINS, endpoint=False).astype(int)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    axes.fill_between(t_s[starts], low, high, color=colour, linewidth=0.4)


def _svg(figure: "Figure", title: str) -> str:
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None, "Title": title}, transparent=True)
    text = drawn.getvalue()
    return re.sub(r' d="[^"]*"', _coarser, text[text.index("<svg") :])


def _coarser(path: "re.Match[str]") -> str:
    """Return a path with hundredths of a point, which is enough."""
    return re.sub(r"(\d+\.\d{2})\d+", r"\1", path.group())
