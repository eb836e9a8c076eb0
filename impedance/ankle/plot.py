"""Stiffness and damping over stance with their intervals, as a picture."""

from pathlib import Path

from impedance.ankle.table import AnkleTable
from messages.errors import UserError
from messages.extras import needs


def draw(path: Path, table: AnkleTable) -> None:
    """Write a picture; raises UserError without matplotlib, which the extra `lab` holds, or where it cannot be
    written."""
    needs("--plot", "matplotlib")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    plots = figure.subplots(2, 2, sharex=True)
    curves = (("stiffness_nm_per_rad", "stiffness, N·m/rad"), ("damping_nms_per_rad", "damping, N·m·s/rad"))
    for column, (title, axis) in enumerate(
        zip(("dorsi-plantarflexion", "inversion-eversion"), table.axes(), strict=True)
    ):
        for row, (name, label) in enumerate(curves):
            plot = plots[row, column]
            low, high = getattr(axis, f"{name}_low"), getattr(axis, f"{name}_high")
            plot.fill_between(table.stance_percent, low, high, alpha=0.3, label="95 %")
            plot.plot(table.stance_percent, getattr(axis, name))
            plot.set_ylabel(label)
            plot.grid(visible=True, alpha=0.3)
        plots[0, column].set_title(title)
        plots[1, column].set_xlabel("stance, %")
    plots[0, 0].legend()
    figure.suptitle(f"{table.subject}, {table.manoeuvre.value}, slope {table.ground_slope_deg:g}°")
    try:
        figure.savefig(path)
    except OSError as error:
        raise UserError(f"--plot {path}: {error.strerror}") from error
