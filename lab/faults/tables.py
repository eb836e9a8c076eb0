"""A campaign in the words and units of a person."""

from collections.abc import Iterator

from lab.faults.fault import Expect, Fault
from lab.faults.report import CampaignReport, TrialReport

COLUMNS = ("fault", "expected", "flagged after", "recovered after", "wrong", "too old", "verdict")
_WORDS = {
    Expect.FLAGGED: "flagged",
    Expect.SILENT: "no output",
    Expect.TOLERATED: "stays valid",
    Expect.HONEST: "valid or flagged",
    Expect.UNDETECTABLE: "not detectable",
    Expect.REFUSED: "refused",
}


def listing(fault: Fault) -> str:
    """Return a fault's lines of the catalogue."""
    limit = f" ≤ {_short(fault.limit_s)}" if fault.expect is Expect.FLAGGED else ""
    walking = " of walking" if fault.in_motion and limit else ""
    why = f"\n    {fault.reason}" if fault.reason else ""
    return f"{fault.name}  {fault.layer.value}, {_WORDS[fault.expect]}{limit}{walking}\n    {fault.how}{why}"


def row(report: TrialReport) -> list[str]:
    """Return a trial's row of the result."""
    limit = f" ≤ {_short(report.limit_s)}" if report.expect is Expect.FLAGGED else ""
    found = report.measured
    if found is None:
        return [report.name, _WORDS[report.expect] + limit, "", "", "", "", report.verdict]
    return [
        report.name,
        _WORDS[report.expect] + limit,
        "" if found.flag_s is None else f"{_short(found.flag_s)} {found.flag_reason}",
        "–" if found.recovery_s is None else f"{found.recovery_s:.2f} s",
        str(found.wrong + found.wrong_on_can + found.wrong_attitudes),
        str(found.stale),
        report.verdict,
    ]


def line(report: TrialReport) -> str:
    """Return a trial in one line, with all that was amiss and what was told."""
    cells = [cell for cell in row(report) if cell]
    if report.measured is not None:
        worst = report.measured
        cells.insert(-1, f"largest errors {worst.worst_slope_deg:.1f}°, {worst.worst_height_mm:.0f} mm")
    return "  ".join(cells) + "".join(f"; {why}" for why in report.failures) + (f" ({report.told})" * bool(report.told))


def summary(report: CampaignReport) -> Iterator[tuple[str, str]]:
    """Yield the campaign's facts, a name and a value each."""
    verdicts = [trial.verdict for trial in report.trials]
    free, process = report.fault_free, report.process
    yield "trials", f"{len(verdicts)}, seed {report.seed}, {report.seconds / 60:.1f} min"
    yield "passed, failed, listed", ", ".join(str(verdicts.count(word)) for word in ("pass", "FAIL", "listed"))
    measured = [t.measured for t in report.trials if t.measured is not None and t.expect is not Expect.UNDETECTABLE]
    yield (
        "wrong ground marked valid, Zenoh, CAN",
        f"{sum(m.wrong for m in measured)}, " + str(sum(m.wrong_on_can for m in measured)),
    )
    yield "wrong attitudes marked valid", str(sum(m.wrong_attitudes for m in measured))
    yield "too old ground marked valid", str(sum(m.stale for m in measured))
    yield "fault-free time", f"{free.seconds:.0f} s, {free.frames} frames"
    yield "of these valid, wrong, too old", f"{100 * free.valid_share:.2f} %, {free.wrong}, {free.stale}"
    yield "wrong attitudes in that time", str(free.wrong_attitudes)
    if process is not None:
        yield "longest run of one daemon", f"{process.seconds:.0f} s"
        yield "its memory", "{:.0f} → {:.0f} MB".format(*process.memory_mb)
        yield "its threads, open files", "{} → {}, ".format(*process.threads) + "{} → {}".format(*process.open_files)
    yield "starts, stops that hung", f"{report.starts}, {report.hung_stops}"
    yield "messages not judged by age (the test itself was late)", str(report.held_up)


def _short(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.1f} s"
