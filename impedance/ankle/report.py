"""The report of an ankle's impedance, for a person: on the screen and as a page."""

from collections.abc import Sequence
from math import degrees
from pathlib import Path

from impedance.ankle.plot import AXES, drawn
from impedance.ankle.table import AnkleTable, AxisTable
from messages.constants import NORMAL_95
from reports.content import Section, Table
from reports.page import check_page, write_sections

_COLUMNS = ("stance", "N·m/rad", "95 %", "N·m·s/rad", "95 %", "mean N·m", "equilibrium °", "by the other axis")
_ROWS = 14
"""About so many of a curve's points are told as numbers."""


def axis_table(found: AnkleTable, axis: AxisTable, title: str) -> Table:
    """Return stiffness, damping, mean moment, equilibrium angle and the stiffness that couples the axes (N·m/rad) over
    stance, with intervals, about one axis."""
    curves = [
        list(zip(*columns, strict=True))
        for columns in (
            (axis.stiffness_nm_per_rad, axis.stiffness_nm_per_rad_low, axis.stiffness_nm_per_rad_high),
            (axis.damping_nms_per_rad, axis.damping_nms_per_rad_low, axis.damping_nms_per_rad_high),
        )
    ]
    set_points = zip(axis.mean_moment_nm, axis.equilibrium_rad, axis.equilibrium_rad_high, strict=True)
    across = zip(axis.cross_stiffness_nm_per_rad, axis.cross_stiffness_nm_per_rad_high, strict=True)
    rows = [
        (
            f"{stance:.1f} %",
            *(f"{k:.1f}", f"{k_low:.1f} to {k_high:.1f}"),
            *(f"{b:.3f}", f"{b_low:.3f} to {b_high:.3f}"),
            *(f"{moment:.1f}", f"{degrees(rest):.2f} ± {degrees(high - rest):.2f}"),
            f"{cross:.1f} ± {cross_high - cross:.1f}",
        )
        for stance, (k, k_low, k_high), (b, b_low, b_high), (moment, rest, high), (cross, cross_high) in zip(
            found.stance_percent, *curves, set_points, across, strict=True
        )
    ]
    return Table(title, _COLUMNS, rows[:: max(1, len(rows) // _ROWS)])


def axis_sentences(axis: AxisTable) -> list[str]:
    """Return the foot's inertia, the quality, and what cannot be identified about one axis and why."""
    inertia = (
        f"foot about the ankle: {axis.foot_inertia_kgm2:.4f} kg m², 95 % "
        f"{axis.foot_inertia_kgm2_low:.4f} to {axis.foot_inertia_kgm2_high:.4f}"
    )
    shares = [100.0 * (share or 0.0) for share in (axis.stiffness_half_share, axis.damping_half_share)]
    quality = "quality: 95 % intervals of ±{:.1f} % (stiffness) and ±{:.1f} % (damping)".format(*shares)
    return [inertia, quality, *(f"not identifiable: {reason}" for reason in axis.not_identifiable)]


def delay_sentence(found: AnkleTable) -> str:
    """Return by how much the wrench is behind the motion, which is taken out, with its 95 % interval."""
    delay_ms, half_ms = 1e3 * (found.wrench_delay_s or 0.0), 1e3 * NORMAL_95 * (found.wrench_delay_deviation_s or 0.0)
    return f"The wrench is {delay_ms:+.3f} ± {half_ms:.3f} ms behind the motion: taken out"


def write_report(path: Path, found: AnkleTable, files: Sequence[Path] = ()) -> None:
    """Write the page; `files` are what was read. Raises UserError where it cannot, or an extra is missing."""
    check_page("a report (--html)")
    sections = [
        Section(title, axis_sentences(axis), axis_table(found, axis, "over stance"), list(drawn(found, axis, title)))
        for title, axis in zip(AXES, found.axes(), strict=True)
    ]
    headline = f"Impedance of the ankle: {found.subject}, {found.manoeuvre.value}, slope {found.ground_slope_deg:g}°"
    lead = (
        f"From {found.perturbed_cycles} perturbed cycles; 0 % is heel strike, 100 % toe off; {delay_sentence(found)}."
    )
    write_sections(path, "Identified on the vibrating platform", headline, sections, files, lead)
