"""What a campaign claims: a row each of claim, goal and figure, as they stand in the results.

Every estimate that was wrong and marked valid stands in exactly one row about wrong estimates; the last of them adds up
the others.
"""

import math
from collections.abc import Callable, Iterator, Sequence

import msgspec
import numpy as np

from lab.faults.criteria import Wrong
from lab.faults.fault import BUS_FLAG_S, FRAME_FLAG_S, MOTION_FLAG_S, RECOVERY_S, USB_RECOVERY_S, Expect
from lab.faults.report import CampaignReport, TrialReport

LEAST_VALID = 0.995
"""Of the frames without a fault and away from edges, this share must be valid."""
_NAMED = 6
_NONE = Wrong()


class Claim(msgspec.Struct, frozen=True, kw_only=True):
    """One row; `met` is None where there is no goal, or nothing that could tell."""

    claim: str
    goal: str
    figure: str
    met: bool | None


def claims(report: CampaignReport) -> Iterator[Claim]:
    """Yield the rows of a campaign."""
    judged = [trial for trial in report.standing if not trial.void]
    yield _trials(report)
    for what, limit_s in (
        ("faults of the IMU's bus and chip", BUS_FLAG_S),
        ("missing, frozen, black, late frames", FRAME_FLAG_S),
        ("data that contradict each other, seconds of walking", MOTION_FLAG_S),
    ):
        flagged = [t for t in judged if t.expect is Expect.FLAGGED and t.limit_s == limit_s]
        yield _times(f"flagged after: {what}", limit_s, flagged, _flag_s)
    for what, limit_s in (("", RECOVERY_S), (", by USB or a new start", USB_RECOVERY_S)):
        over = [t for t in judged if t.measured is not None and t.recovery_limit_s == limit_s]
        yield _times(f"recovery after the fault{what}", limit_s, over, _recovery_s)
    stale = report.fault_free.stale + sum(t.measured.stale for t in report.trials if t.measured is not None)
    yield Claim(claim="ground marked valid and too old", goal="0", figure=str(stale), met=not stale)
    yield from _wrong(report)
    yield from _without_a_fault(report)


def _trials(report: CampaignReport) -> Claim:
    verdicts = [trial.verdict for trial in report.standing]
    failed = [trial.name for trial in report.standing if trial.verdict == "FAIL"]
    counts = ", ".join(
        f"{verdicts.count(word)} {told}"
        for word, told in (("pass", "passed"), ("FAIL", "failed"), ("listed", "undetectable"), ("void", "void"))
    )
    return Claim(
        claim=f"trials, seed {report.seed}, {report.seconds / 60:.1f} min",
        goal="none fails",
        figure=f"{len(verdicts)}: {counts}{_those(failed)}",
        met=not failed,
    )


def _times(claim: str, limit_s: float, trials: Sequence[TrialReport], of: Callable[[TrialReport], float]) -> Claim:
    """Return how long it took, and in how many trials no longer than `limit_s`; infinite stands for never."""
    times_s = [of(trial) for trial in trials]
    late = [trial.name for trial, s in zip(trials, times_s, strict=True) if s > limit_s]
    finite_s = [s for s in times_s if s < math.inf]
    figure = f"{len(trials) - len(late)} of {len(trials)} within{_those(late)}"
    if finite_s:
        median_s = float(np.median(finite_s))
        figure = f"{_short(min(finite_s))} to {_short(max(finite_s))}, median {_short(median_s)}; {figure}"
    return Claim(claim=claim, goal=_short(limit_s), figure=figure, met=not late if trials else None)


def _flag_s(trial: TrialReport) -> float:
    found = trial.measured
    return math.inf if found is None or found.flag_s is None else found.flag_s


def _recovery_s(trial: TrialReport) -> float:
    found = trial.measured
    return math.inf if found is None or found.recovery_s is None else found.recovery_s


def _wrong(report: CampaignReport) -> Iterator[Claim]:
    """Yield a row for each place where something wrong may have been heard, and their sum."""
    sound = [trial for trial in report.trials if not trial.void and trial.measured is not None]
    listed = [trial for trial in sound if trial.expect is Expect.UNDETECTABLE]
    detectable = [trial for trial in sound if trial.expect is not Expect.UNDETECTABLE]
    yield _wrong_in("single faults that can be detected", [t for t in detectable if t.faults == 1], goal="0")
    yield _wrong_in("pairs of faults", [t for t in detectable if t.faults > 1], goal="0")
    yield _wrong_in("undetectable faults", listed, goal="counted")
    void = [trial for trial in report.trials if trial.void]
    yield _wrong_in("void trials and the time about them", void, goal="counted", besides=report.disturbed)
    free = report.fault_free.all_wrong()
    yield _wrong_row("without a fault", free, f"{report.fault_free.frames} frames", goal="0")
    yield _wrong_row("starts and disturbed time", report.elsewhere, "", goal="0")
    yield _wrong_row("all of these", report.all_wrong(), "", goal="")


def _wrong_in(place: str, trials: Sequence[TrialReport], goal: str, besides: Wrong = _NONE) -> Claim:
    total = sum((trial.wrong for trial in trials), besides)
    amiss = [trial for trial in trials if trial.wrong]
    found = [trial.measured for trial in amiss if trial.measured is not None]
    where = f"{len(trials)} trials"
    if found:
        worst_deg, worst_mm = max(m.worst_slope_deg for m in found), max(m.worst_height_mm for m in found)
        where = f"{len(amiss)} of {where}, largest errors {worst_deg:.1f}°, {worst_mm:.0f} mm"
    return _wrong_row(place, total, where + _those([trial.name for trial in amiss]), goal)


def _wrong_row(place: str, total: Wrong, where: str, goal: str) -> Claim:
    figure = f"{total.zenoh} grounds, {total.can} on CAN, {total.attitudes} attitudes" + f"; {where}" * bool(where)
    return Claim(
        claim=f"wrong and marked valid: {place}", goal=goal, figure=figure, met=not total if goal == "0" else None
    )


def _without_a_fault(report: CampaignReport) -> Iterator[Claim]:
    free, process = report.fault_free, report.process
    share = free.away_valid_share
    yield Claim(
        claim="valid without a fault, away from edges",
        goal=f"{100 * LEAST_VALID:.1f} %",
        figure=f"{100 * share:.2f} % of {free.away} frames; of all {free.frames} {100 * free.valid_share:.2f} %"
        if free.frames
        else f"none: the host disturbed {free.left_out_s:.0f} s",
        met=share >= LEAST_VALID if free.away else None,
    )
    yield Claim(
        claim=f"stops that hung, of {report.starts} starts",
        goal="0",
        figure=str(report.hung_stops),
        met=not report.hung_stops,
    )
    if process is not None:
        yield Claim(
            claim=f"one daemon for {process.seconds:.0f} s: memory, threads, open files",
            goal="",
            figure="{:.0f} to {:.0f} MB, ".format(*process.memory_mb)
            + "{} to {}, ".format(*process.threads)
            + "{} to {}".format(*process.open_files),
            met=None,
        )
    yield Claim(
        claim="messages whose age was not judged: the test itself was held up",
        goal="",
        figure=str(report.held_up),
        met=None,
    )


def _those(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" * (len(names) > _NAMED)
    return f" ({', '.join(names[:_NAMED])}{more})" * bool(names)


def _short(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.2f} s"
