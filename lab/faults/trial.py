"""One trial: what was heard while a fault came, stayed and went, and the verdict on it."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import islice, takewhile
from typing import NamedTuple

import msgspec

from lab.faults.fault import Expect
from lab.faults.listener import Heard, HeardAttitude, HeardOnCan
from messages import TOPICS, Reason

STEADY_FRAMES = 10
"""Valid frames in a row, none of them wrong, that make a recovery."""
FLAG_GRACE_S = 0.3
"""A flag still counts this long after the cause is gone, for a fault shorter than what is allowed to flag it."""
LASTING_FLAGS = 4
"""So many flags within twice as many frames make one that is more than chance."""
LEAST_SHARE = 0.9
"""Of the frames due, this many must be heard while a fault is tolerated; the host may delay some."""
_FRAME_S = 1.0 / TOPICS["ground"].rate_hz
_FRESH_NS = 200_000_000  # the newest ground may be so old: four frames


class Times(NamedTuple):
    """When the fault came and went and the trial ended, CLOCK_MONOTONIC."""

    inject_ns: int
    clear_ns: int
    end_ns: int


class Expectation(NamedTuple):
    """What must follow, and by when. A flag for one of the `foreign` reasons is chance, not detection.

    `share` of the frames remains while the fault lasts.
    """

    expect: Expect
    limit_s: float
    in_motion: bool
    recovery_s: float
    foreign: frozenset[Reason] = frozenset()
    share: float = 1.0


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """What a consumer heard. Times are None where nothing came; `flag_s` counts walking only, if so expected.

    `wrong` and `stale` count grounds marked valid, on Zenoh and (wrong ones) on CAN; the worst errors are of those
    heard on Zenoh while the fault lasted and until it was over. `wrong_told` has a line for each wrong one on Zenoh.
    """

    flag_s: float | None
    flag_reason: str
    recovery_s: float | None
    frames: int
    flags: int
    wrong: int
    stale: int
    wrong_on_can: int
    wrong_attitudes: int
    worst_slope_deg: float
    worst_height_mm: float
    wrong_told: list[str] = []


def measure(
    grounds: Sequence[Heard],
    attitudes: Sequence[HeardAttitude],
    on_can: Sequence[HeardOnCan],
    times: Times,
    expected: Expectation,
    walked_s: Callable[[int, int], float],
) -> Measured:
    """Return what was heard in one trial. `walked_s` tells how long the wearer walked between two instants.

    What takes motion to be seen is flagged by a ground that is refused for some frames; a single one is chance.
    """
    heard = [h for h in grounds if times.inject_ns < h.t_ns <= times.end_ns]
    after_injection = [a for a in attitudes if times.inject_ns < a.t_ns <= times.end_ns]
    can = [c for c in on_can if times.inject_ns < c.t_ns <= times.end_ns]
    last_flag_ns = times.clear_ns + round(FLAG_GRACE_S * 1e9)
    signals = [(h.t_ns, h.ground.reason) for h in _flagged(heard, LASTING_FLAGS if expected.in_motion else 1)]
    if not expected.in_motion:
        signals += [(a.t_ns, a.reason) for a in after_injection if not a.valid]
    signals = [(t_ns, why) for t_ns, why in signals if t_ns <= last_flag_ns and why not in expected.foreign]
    flag_ns, reason = min(signals, default=(None, None))
    during = [h for h in heard if h.t_ns <= times.clear_ns]
    return Measured(
        flag_s=None if flag_ns is None else walked_s(times.inject_ns, flag_ns),
        flag_reason="" if reason is None else reason.value,
        recovery_s=recovery_s(heard, can, times.clear_ns),
        frames=len(during),
        flags=sum(h.flag for h in during),
        wrong=sum(h.errors.wrong for h in heard),
        stale=sum(h.stale for h in heard),
        wrong_on_can=sum(c.errors.wrong for c in can),
        wrong_attitudes=sum(a.wrong for a in after_injection),
        worst_slope_deg=math.degrees(max((h.errors.slope_rad for h in heard), default=0.0)),
        worst_height_mm=1e3 * max((h.errors.height_m for h in heard), default=0.0),
        wrong_told=[_wrong_line(h, times) for h in heard if h.errors.wrong],
    )


def _wrong_line(heard: Heard, times: Times) -> str:
    """Return when a wrong ground was exposed, what it told, with stated deviations, and the truth."""
    told, true = heard.ground, heard.truth
    sagittal, frontal, height = (math.sqrt(told.covariance[i]) for i in (0, 3, 5))
    since_s, after_s = (1e-9 * (told.t_exposure_ns - t_ns) for t_ns in (times.inject_ns, times.clear_ns))
    return (
        f"{since_s:.2f} s after the fault began, {after_s:.2f} s after its end{', at an edge' * true.transition}: "
        f"slopes {math.degrees(told.slope_sagittal_rad):.2f} and {math.degrees(told.slope_frontal_rad):.2f}° "
        f"(sd {math.degrees(sagittal):.2f}, {math.degrees(frontal):.2f}), height {1e3 * told.height_m:.0f} mm "
        f"(sd {1e3 * height:.0f}); true {math.degrees(true.slope_sagittal_rad):.2f}, "
        f"{math.degrees(true.slope_frontal_rad):.2f}°, {1e3 * true.height_m:.0f} mm"
    )


def _flagged(heard: Sequence[Heard], lasting: int) -> Iterator[Heard]:
    """Yield the flags that begin `lasting` or more among the next twice as many grounds."""
    for place, h in enumerate(heard):
        if _flags(heard[place:]) and sum(later.flag for later in heard[place : place + 2 * lasting]) >= lasting:
            yield h


def _flags(heard: Sequence[Heard]) -> bool:
    """Return whether the first is a flag: a refusal at an edge is, if the edge goes by and the same refusal goes on."""
    same = takewhile(lambda h: not h.valid and h.ground.reason is heard[0].ground.reason, heard)
    return any(h.flag for h in same)


def recovery_s(heard: Sequence[Heard], on_can: Sequence[HeardOnCan], clear_ns: int) -> float | None:
    """Return how long after `clear_ns` both outlets gave ground again; None if not, or not steadily."""
    again_ns = _steady_from_ns([h for h in heard if h.t_ns > clear_ns])
    can_ns = next((c.t_ns for c in on_can if c.t_ns > clear_ns), None)
    if again_ns is None or can_ns is None:
        return None
    return 1e-9 * (max(again_ns, can_ns) - clear_ns)


def _steady_from_ns(heard: Sequence[Heard]) -> int | None:
    """Return when the first run of STEADY_FRAMES right grounds began; a refusal at an edge is passed over."""
    run: list[int] = []
    for h in heard:
        if h.flag or h.errors.wrong:
            run.clear()
        elif h.valid:
            run.append(h.t_ns)
            if len(run) == STEADY_FRAMES:
                return run[0]
    return None


def is_steady(grounds: Sequence[Heard], since_ns: int, frames: int, now_ns: int) -> bool:
    """Return whether the newest `frames` grounds, all after `since_ns`, are right and the newest one is fresh."""
    newest = list(islice(reversed(grounds), frames))
    return (
        len(newest) == frames
        and newest[-1].t_ns > since_ns
        and not any(h.flag or h.errors.wrong for h in newest)
        and newest[0].t_ns > now_ns - _FRESH_NS
    )


def failures(expected: Expectation, found: Measured, hold_s: float) -> Iterator[str]:
    """Yield why a trial did not end as it must."""
    listed = expected.expect is Expect.UNDETECTABLE
    if expected.expect is Expect.FLAGGED:
        if found.flag_s is None:
            yield "never flagged"
        elif found.flag_s > expected.limit_s:
            yield f"flagged after {1e3 * found.flag_s:.0f} ms"
    if expected.expect is Expect.TOLERATED:
        if found.flags:
            yield f"{found.flags} frames marked invalid ({found.flag_reason})"
        if found.frames < LEAST_SHARE * expected.share * hold_s / _FRAME_S - 1.0:
            yield f"only {found.frames} frames in {hold_s:g} s"
    if not listed:
        if found.wrong:
            yield f"{found.wrong} wrong ground estimates"
        if found.wrong_on_can:
            yield f"{found.wrong_on_can} wrong ground estimates on CAN"
        if found.wrong_attitudes:
            yield f"{found.wrong_attitudes} wrong attitudes"
    if found.stale:
        yield f"{found.stale} ground estimates too old"
    if found.recovery_s is None:
        yield "did not recover"
    elif found.recovery_s > expected.recovery_s:
        yield f"recovered after {found.recovery_s:.1f} s"
