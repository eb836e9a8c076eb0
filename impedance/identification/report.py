"""The report of an identification, for a person, and the same facts for a program."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from impedance.identification import checks
from impedance.identification.identification import Identification
from impedance.identification.observability import NAMES
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.errors import UserError
from reports.content import Section, Table
from reports.drawing import AFTER, BEFORE, INK, drawing
from reports.page import check_page, write_sections

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAGE = "report.html"
SHOWN_UNITS = ("kg", *("mm",) * 3, *("g m²",) * 6)
SHOWN_SCALE = np.array([1.0, *(1e3,) * 9])
HEADING = ("", "estimate", "95 % interval", "unit")
_CHANNELS = ("fx", "fy", "fz", "Tx", "Ty", "Tz")
_BANDS = 60
_MOVED_CHI2 = 1e-3


def parameter_rows(found: Identification) -> list[list[str]]:
    """Return name, estimate, interval and unit of the ten parameters, as text; what cannot be told says so."""
    rows = []
    for k, name in enumerate(NAMES):
        low, high = found.interval[k] * SHOWN_SCALE[k]
        value = found.estimate[k] * SHOWN_SCALE[k]
        digits = checks.digits_of(0.5 * (high - low))
        if found.observability.identifiable[k]:
            rows.append([name, f"{value:.{digits}f}", f"{low:.{digits}f} … {high:.{digits}f}", SHOWN_UNITS[k]])
        else:
            rows.append([name, "not identifiable", f"± {0.5 * (high - low):.3g}", SHOWN_UNITS[k]])
    return rows


def check_rows(found: Identification) -> list[list[str]]:
    """Return what the misfit and the markers say of the instruments, as text."""
    return checks.rows(found.checked, found.test, found.stated.joint_m)


def remarks(found: Identification) -> list[str]:
    """Return what a person must know beside the table, one line each."""
    test, observable = found.test, found.observability
    lines = [
        f"{'with' if found.constrained else 'without'} the joint's constraint; the markers "
        f"{'agree with' if test.holds else 'refute'} the joint ({test.sigmas:+.1f} standard deviations)",
        f"what is left is {found.chi2_left:.3f} times the noise's power, over {found.spectra.counted_s:.1f} s",
        f"singular values, greatest to least: {' '.join(f'{value:.3g}' for value in _relative(found))}",
        f"least known direction: {observable.null_words}",
    ]
    if not observable.identifiable.all():
        names = ", ".join(name for name, yes in zip(NAMES, observable.identifiable, strict=True) if not yes)
        lines.append(f"not identifiable from this recording: {names}; these change together unseen, see above")
    if found.boundary is not None:
        lines.append(f"{found.boundary.words}; the likeliest parameters are {found.pull_chi2:.1f} away in χ²")
    elif found.pull_chi2 > _MOVED_CHI2:
        lines.append(f"moved to a body that can exist, {found.pull_chi2:.1f} away in χ²")
    return [*lines, *found.notes]


def facts(found: Identification) -> dict[str, object]:
    """Return the identification for a program: SI units, null where nothing is known."""
    null = found.observability.null * found.observability.range
    return {
        "body": found.what,
        "with_joint": found.constrained,
        "parameters": {
            name: {
                "estimate": float(found.estimate[k]) if found.observability.identifiable[k] else math.nan,
                "interval_95": found.interval[k].tolist(),
                "deviation": float(found.observability.deviation[k]),
                "deviation_of_noise": float(found.noise_deviation[k]),
                "identifiable": bool(found.observability.identifiable[k]),
            }
            for k, name in enumerate(NAMES)
        },
        "singular_values": _relative(found).tolist(),
        "null_direction": dict(zip(NAMES, null.tolist(), strict=True)),
        "boundary": None if found.boundary is None else found.boundary.words,
        "pull_chi2": found.pull_chi2,
        "chi2_ratio": found.chi2_left,
        "joint_sigmas": found.test.sigmas,
        "checks": checks.facts(found.checked, found.test),
        "notes": list(found.notes),
    }


def write_report(found: Identification, folder: Path, files: Sequence[Path] = ()) -> None:
    """Write the page into `folder`, which is made; `files` are the recordings that were read.

    Raises UserError where it cannot, or where what draws and renders is not installed.
    """
    check_page("a report (--out)")
    title = f"Inertia of the {found.what}"
    table = Table("about its centre of gravity", HEADING, parameter_rows(found))
    drawings = (
        drawing("What the recording tells", partial(_draw_intervals, found), 2.4),
        drawing("Misfit over frequency", partial(_draw_misfit, found), 2.4),
    )
    instruments = Table("as markers and misfit see them", checks.HEADING, check_rows(found))
    sections = (
        Section("Instruments", (), instruments),
        Section("Ten parameters", remarks(found), table, drawings),
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {folder}: {error.strerror}") from error
    write_sections(folder / PAGE, "Identified on the vibrating platform", title, sections, files)


def _draw_intervals(found: Identification, axes: "Axes") -> None:
    share = found.observability.deviation * NORMAL_95 / found.observability.range
    colours = [AFTER if yes else BEFORE for yes in found.observability.identifiable]
    axes.bar(NAMES, 100.0 * share, color=colours)
    axes.axhline(50.0, color=BEFORE, linewidth=1.0)
    axes.set(
        yscale="log", ylabel="half interval, % of range", title="What the recording tells, of a rigid body's range"
    )
    axes.tick_params(axis="x", rotation=60)


def _draw_misfit(found: Identification, axes: "Axes") -> None:
    power = np.abs(found.fit.misfit) ** 2 / 2.0
    f_hz = found.spectra.f_hz[found.spectra.share > 0.0]
    edges = np.linspace(0, len(f_hz), _BANDS + 1).astype(int)[:-1]
    width = np.diff(np.append(edges, len(f_hz)))
    middle = np.add.reduceat(f_hz, edges) / width
    for channel, name in enumerate(_CHANNELS):
        axes.plot(middle, np.add.reduceat(power[:, channel], edges) / width, label=name, linewidth=1.0)
    axes.axhline(1.0, color=INK, linewidth=0.8)
    axes.set(xlabel="Hz", ylabel="left over / noise's power", yscale="log", title="Misfit")
    axes.legend(ncols=6, loc="lower right", bbox_to_anchor=(1.0, 1.0), columnspacing=0.8, handlelength=1.0)


def _relative(found: Identification) -> FloatArray:
    values: FloatArray = found.observability.singular_values / found.observability.singular_values[0]
    return values
