"""A campaign in the words and units of a person."""

from lab.faults.claims import Claim
from lab.faults.fault import Expect, Fault
from lab.faults.report import TrialReport

CLAIM_COLUMNS = ("claim", "goal", "figure")
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
    return (
        "  ".join(cells)
        + "".join(f"; {why}" for why in (*report.failures, report.void) if why)
        + (f" ({report.told})" * bool(report.told))
    )


def claim_row(claim: Claim) -> list[str]:
    """Return a claim's row; a goal that was missed is marked."""
    return [claim.claim, claim.goal, claim.figure + " MISSED" * (claim.met is False)]


def _short(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.1f} s"
