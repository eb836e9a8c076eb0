"""The report of an identification: a page in Markdown with two plots, and the same facts for a program."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from impedance.identification import checks
from impedance.identification.identification import Identification
from impedance.identification.observability import NAMES
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.errors import UserError
from messages.extras import needs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE, INTERVALS, MISFIT = "report.md", "intervals.png", "misfit.png"
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


def write_report(found: Identification, folder: Path) -> None:
    """Write page and plots into `folder`; raises UserError where it cannot, or where matplotlib is not installed."""
    needs("a report with plots (--out)", "matplotlib")
    from matplotlib.figure import Figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, draw in ((INTERVALS, _draw_intervals), (MISFIT, _draw_misfit)):
            figure = Figure(figsize=(8.0, 4.5), layout="constrained")
            draw(figure, found)
            figure.savefig(folder / name, dpi=120)
        (folder / PAGE).write_text(_page(found), encoding="utf-8")
    except OSError as error:
        raise UserError(f"--out {folder}: {error.strerror}") from error


def _page(found: Identification) -> str:
    lines = [f"# Inertia of the {found.what}", "", "| " + " | ".join(HEADING) + " |", "|---|---:|---:|---|"]
    lines += ["| " + " | ".join(row) + " |" for row in parameter_rows(found)]
    lines += ["", "## Instruments", "", "| " + " | ".join(checks.HEADING) + " |", "|---|---:|---:|---:|---|---|"]
    lines += ["| " + " | ".join(row) + " |" for row in check_rows(found)]
    lines += ["", *(f"- {remark}" for remark in remarks(found)), ""]
    lines += [f"![Intervals]({INTERVALS})", "", f"![Misfit over frequency]({MISFIT})", ""]
    return "\n".join(lines)


def _draw_intervals(figure: "Figure", found: Identification) -> None:
    axes = figure.subplots()
    share = found.observability.deviation * NORMAL_95 / found.observability.range
    colours = ["tab:blue" if yes else "tab:red" for yes in found.observability.identifiable]
    axes.bar(NAMES, 100.0 * share, color=colours)
    axes.axhline(50.0, color="tab:red", linewidth=1.0)
    axes.set(yscale="log", ylabel="half interval, % of a rigid body's range", title="What the recording tells")


def _draw_misfit(figure: "Figure", found: Identification) -> None:
    axes = figure.subplots()
    power = np.abs(found.fit.misfit) ** 2 / 2.0
    f_hz = found.spectra.f_hz[found.spectra.share > 0.0]
    edges = np.linspace(0, len(f_hz), _BANDS + 1).astype(int)[:-1]
    width = np.diff(np.append(edges, len(f_hz)))
    middle = np.add.reduceat(f_hz, edges) / width
    for channel, name in enumerate(_CHANNELS):
        axes.plot(middle, np.add.reduceat(power[:, channel], edges) / width, label=name, linewidth=1.0)
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set(xlabel="Hz", ylabel="left over, in units of the noise's power", yscale="log", title="Misfit")
    axes.legend(ncols=6)


def _relative(found: Identification) -> FloatArray:
    values: FloatArray = found.observability.singular_values / found.observability.singular_values[0]
    return values
