"""The errors by cause, as a picture and as drawings of a report."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lab.evaluation.causes.ledger import CauseScore
from messages.errors import UserError
from messages.extras import needs
from reports.drawing import AFTER, BEFORE, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PANELS = (("slope ahead, °", "sagittal_deg"), ("slope across, °", "frontal_deg"), ("height, mm", "height_mm"))


def draw(path: Path, title: str, scores: Sequence[CauseScore]) -> None:
    """Write a picture: of each cause what it makes of the errors, and what is left without it.

    Raises UserError without matplotlib, which the extra `lab` holds, or where it cannot be written.
    """
    needs("--plot", "matplotlib")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 0.9 + 0.5 * len(scores)), layout="constrained")
    for axes, (label, name) in zip(figure.subplots(1, 3, sharey=True), _PANELS, strict=True):
        _draw_bars(scores, label, name, axes)
    axes.invert_yaxis()
    axes.legend()
    figure.suptitle(title)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise UserError(f"--plot {path}: {error}") from error


def drawn(scores: Sequence[CauseScore]) -> list[str]:
    """Return the same as drawings: slope ahead, slope across, height."""

    def panel(label: str, name: str, axes: "Axes") -> None:
        _draw_bars(scores, label, name, axes)
        axes.invert_yaxis()
        axes.legend(ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))

    height_in = 0.9 + 0.4 * len(scores)
    return [drawing(label, partial(panel, label, name), height_in) for label, name in _PANELS]


def _draw_bars(scores: Sequence[CauseScore], label: str, name: str, axes: "Axes") -> None:
    place = np.arange(len(scores))
    made, left = ([getattr(score, f"{part}_{name}") for score in scores] for part in ("part", "left"))
    axes.barh(place - 0.2, made, 0.4, label="what it makes", color=BEFORE)
    axes.barh(place + 0.2, left, 0.4, label="left without it", color=AFTER)
    axes.set_xlabel(f"{label}, RMS")
    axes.grid(visible=True, axis="x", alpha=0.3)
    axes.set_yticks(place, [score.name for score in scores])
