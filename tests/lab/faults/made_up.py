"""Attempts at trials that never took place."""

from collections.abc import Sequence

from lab.faults.criteria import Wrong
from lab.faults.fault import Expect
from lab.faults.report import Attempt, FaultFree, TrialReport
from lab.faults.trial import Measured


def attempt(
    name: str = "cam-frozen",
    *,
    faults: int = 1,
    expect: Expect = Expect.FLAGGED,
    limit_s: float = 0.15,
    flag_s: float | None = 0.1,
    failures: Sequence[str] = (),
    void: str = "",
    wrong: Wrong | None = None,
    free: FaultFree | None = None,
    elsewhere: Wrong | None = None,
) -> Attempt:
    """Return an attempt at a trial that recovered after a second."""
    wrong = wrong or Wrong()
    measured = Measured(
        flag_s=flag_s,
        flag_reason="frozen_frame",
        recovery_s=1.0,
        frames=30,
        flags=28,
        wrong=wrong.zenoh,
        stale=0,
        wrong_on_can=wrong.can,
        wrong_attitudes=wrong.attitudes,
        worst_slope_deg=4.5,
        worst_height_mm=12.0,
    )
    trial = TrialReport(
        name=name,
        faults=faults,
        layer="camera",
        how="",
        expect=expect,
        limit_s=limit_s,
        recovery_limit_s=2.0,
        reason="",
        measured=measured,
        failures=list(failures),
        counted={},
        rig_late=0,
        void=void,
    )
    return Attempt(
        trial=trial,
        seconds=6.0,
        fault_free=free or FaultFree(),
        elsewhere=elsewhere or Wrong(),
        starts=1,
        hung_stops=0,
        held_up=0,
        process=None,
    )
