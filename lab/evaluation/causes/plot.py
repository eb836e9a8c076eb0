"""The errors by cause, as a picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lab.evaluation.causes.ledger import CauseScore
from messages.errors import UserError
from messages.extras import needs


def draw(path: Path, title: str, scores: Sequence[CauseScore]) -> None:
    """Write a picture: of each cause what it makes of the errors, and what is left without it.

    Raises UserError without matplotlib, which the extra `lab` holds, or where it cannot be written.
    """
    needs("--plot", "matplotlib")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 0.9 + 0.5 * len(scores)), layout="constrained")
    place = np.arange(len(scores))
    panels = (("slope ahead, °", "sagittal_deg"), ("slope across, °", "frontal_deg"), ("height, mm", "height_mm"))
    for axes, (label, name) in zip(figure.subplots(1, 3, sharey=True), panels, strict=True):
        axes.barh(place - 0.2, [getattr(score, f"part_{name}") for score in scores], 0.4, label="what it makes")
        axes.barh(place + 0.2, [getattr(score, f"left_{name}") for score in scores], 0.4, label="left without it")
        axes.set_xlabel(f"{label}, RMS")
        axes.grid(visible=True, axis="x", alpha=0.3)
        axes.set_yticks(place, [score.name for score in scores])
    axes.invert_yaxis()
    axes.legend()
    figure.suptitle(title)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise UserError(f"--plot {path}: {error}") from error
