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

_FEW_DECADES = 200.0
"""Times the lowest number of a logarithmic scale that the highest is, below which its decades alone say too little."""
_WRITTEN_OUT = (1e-3, 1e4)
"""Numbers that are written out; others have an exponent."""

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
        _plain_numbers(axes)
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None, "Title": title}, transparent=True)
    text = drawn.getvalue()
    text = re.sub(r" *<metadata>.*?</metadata>\n", "", text[text.index("<svg") :], flags=re.DOTALL)
    return re.sub(r' d="[^"]*"', _coarser, text)


def _plain_numbers(axes: "Axes") -> None:
    """Write the numbers of logarithmic scales as 0.2 or 1e-05, as small raised exponents cannot be read on a telephone,
    and those of linear ones whole, not as what is to be added to a number in the corner. A logarithmic scale of few
    decades, as of a short recording, has 1, 2 and 5 of each.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, ScalarFormatter

    for axis, scale in ((axes.xaxis, axes.get_xscale()), (axes.yaxis, axes.get_yscale())):
        if scale == "log":
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _FEW_DECADES * low else (1.0,)))
            axis.set_major_formatter(FuncFormatter(_plain_number))
            axis.set_minor_formatter(NullFormatter())
        elif scale == "linear" and isinstance(axis.get_major_formatter(), ScalarFormatter):
            axis.set_major_formatter(ScalarFormatter(useOffset=False))


def _plain_number(value: float, _place: int | None = None) -> str:
    low, high = _WRITTEN_OUT
    return (f"{value:g}" if low <= value < high else f"{value:.0e}").replace("-", "\N{MINUS SIGN}")


def _coarser(path: "re.Match[str]") -> str:
    """Return a path with hundredths of a point, which is enough."""
    return re.sub(r"(\d+\.\d{2})\d+", r"\1", path.group())
