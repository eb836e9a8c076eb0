"""Stiffness and damping over stance with their intervals, as a picture and as drawings of a report."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from impedance.ankle.table import AnkleTable, AxisTable
from messages.errors import UserError
from messages.extras import needs
from reports.drawing import AFTER, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXES = ("dorsi-plantarflexion", "inversion-eversion")
_CURVES = (("stiffness_nm_per_rad", "stiffness, N·m/rad"), ("damping_nms_per_rad", "damping, N·m·s/rad"))


def draw(path: Path, table: AnkleTable) -> None:
    """Write a picture; raises UserError without matplotlib, which the extra `lab` holds, or where it cannot be
    written."""
    needs("--plot", "matplotlib")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    plots = figure.subplots(2, 2, sharex=True)
    for column, (title, axis) in enumerate(zip(AXES, table.axes(), strict=True)):
        for row, (name, label) in enumerate(_CURVES):
            _draw_curve(table, axis, name, label, plots[row, column])
        plots[0, column].set_title(title)
        plots[1, column].set_xlabel("stance, %")
    plots[0, 0].legend()
    figure.suptitle(f"{table.subject}, {table.manoeuvre.value}, slope {table.ground_slope_deg:g}°")
    try:
        figure.savefig(path)
    except OSError as error:
        raise UserError(f"--plot {path}: {error.strerror}") from error


def drawn(table: AnkleTable, axis: AxisTable, title: str) -> Iterator[str]:
    """Yield a drawing of each curve of one axis, whose name is `title`."""
    for name, label in _CURVES:
        yield drawing(f"{title}: {label}", partial(_draw_curve, table, axis, name, label))


def _draw_curve(table: AnkleTable, axis: AxisTable, name: str, label: str, plot: "Axes") -> None:
    low, high = getattr(axis, f"{name}_low"), getattr(axis, f"{name}_high")
    plot.fill_between(table.stance_percent, low, high, alpha=0.3, color=AFTER, label="95 %", linewidth=0)
    plot.plot(table.stance_percent, getattr(axis, name), color=AFTER)
    plot.set(ylabel=label, xlabel="stance, %")
    plot.grid(visible=True, alpha=0.3)
