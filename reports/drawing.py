"""Drawings of a report, as SVG inside the page: each no wider than a telephone's screen, so that it stays legible."""

import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from messages.extras import needs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BEFORE, AFTER, FLOOR = "#c2622d", "#1f5a85", "#8a8f94"
"""Of what was, of what was found, and of what is left to chance: the same on every page."""
INK = "#3c4146"
_RULE = "#d5d9dc"
WIDTH_IN = 4.2
"""At 72 points an inch and 380 pixels of a page 420 wide, letters of nine points are eleven pixels high."""

_SETTINGS: dict[str, Any] = {  # too many keys to be typed
    "svg.fonttype": "none",
    "font.size": 9.0,
    "axes.edgecolor": _RULE,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
}


def drawing(title: str, draw: "Callable[[Axes], object]", height_in: float = 1.9) -> str:
    """Return one drawing as SVG: `draw` is given its axes. `title` tells it apart from the others of a page.

    Raises UserError where matplotlib is not installed, which the extra `lab` brings.
    """
    needs("a report with drawings", "matplotlib")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    settings: Any = {**_SETTINGS, "svg.hashsalt": title}  # names inside two drawings must not meet on one page
    with rc_context(settings):
        figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
        axes = figure.subplots()
        draw(axes)
        _plain_decades(axes)
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None, "Title": title}, transparent=True)
    text = drawn.getvalue()
    text = re.sub(r" *<metadata>.*?</metadata>\n", "", text[text.index("<svg") :], flags=re.DOTALL)
    return re.sub(r' d="[^"]*"', _coarser, text)


def _plain_decades(axes: "Axes") -> None:
    """Write the numbers of logarithmic scales as 1e-03: small raised exponents cannot be read on a telephone."""
    from matplotlib.ticker import LogFormatter

    for axis, scale in ((axes.xaxis, axes.get_xscale()), (axes.yaxis, axes.get_yscale())):
        if scale == "log":
            axis.set_major_formatter(LogFormatter())
            axis.set_minor_formatter(LogFormatter(labelOnlyBase=False, minor_thresholds=(1.0, 0.4)))


def _coarser(path: "re.Match[str]") -> str:
    """Return a path with hundredths of a point, which is enough."""
    return re.sub(r"(\d+\.\d{2})\d+", r"\1", path.group())
