"""The campaign: trials of one fault, or of two at once, one after the other.

Each trial: wait until the ground is steadily valid, inject, hold, clear, watch the recovery.
"""

import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from lab.faults.catalogue import carry_out, expected_together
from lab.faults.daemon_process import DaemonPlan, DaemonProcess
from lab.faults.daemon_under_test import SCENARIO, DaemonUnderTest
from lab.faults.fault import FOREIGN, Command, Expect, Fault, Restart
from lab.faults.report import CampaignReport, TrialReport
from lab.faults.trial import Expectation, Measured, Times, failures, measure, recovery_s
from messages import UserError

_AFTER_FLAG_S = 1.5  # a fault that waits for motion lasts so long after its flag
_HEALTH_S = 1.1  # until the next health message, one a second, has come
_COMMAND_S = 60.0  # within which a command must end
_ATTEMPTS = 3  # of a trial in which the rig itself lost frames
_ALWAYS_COUNTED = ("imu_samples", "frames", "frames_valid", "ankle_states")


@dataclass(frozen=True)
class Trial:
    """One fault, or two that strike at once."""

    faults: tuple[Fault, ...]

    @property
    def name(self) -> str:
        """Return the names, joined."""
        return " + ".join(fault.name for fault in self.faults)

    @property
    def hold_s(self) -> float:
        """Return how long both last."""
        return max(fault.hold_s for fault in self.faults)

    @property
    def in_motion(self) -> bool:
        """Return whether the wearer has to walk."""
        return any(fault.in_motion for fault in self.faults)

    @property
    def expectation(self) -> Expectation:
        """Return what must follow."""
        first = self.faults[0]
        expect, limit_s, in_motion = first.expect, first.limit_s, first.in_motion
        if len(self.faults) == 2:
            expect, limit_s, in_motion = expected_together(first, self.faults[1])
        foreign = frozenset.intersection(*(FOREIGN.get(fault.layer, frozenset()) for fault in self.faults))
        longest_s = max(fault.recovery_s for fault in self.faults)
        share = math.prod(fault.share for fault in self.faults)
        return Expectation(expect, limit_s, in_motion, longest_s, foreign, share)

    @property
    def needs_a_start(self) -> bool:
        """Return whether the daemon does not simply run on."""
        return any(
            isinstance(f.act, Restart | Command) or (not f.touches and f.expect is Expect.SILENT) for f in self.faults
        )


class Campaign:
    """Runs trials in `folder`, an empty one, and tells `tell` of each as it ends. Close it when done.

    `patience_s` is how long it waits for the ground to become steady, and steady again, before it gives up.
    """

    def __init__(
        self, seed: int, folder: Path, tell: Callable[[TrialReport], None], *, patience_s: float = 15.0
    ) -> None:
        self._seed = seed
        self._folder = folder
        self._tell = tell
        self._patience_s = patience_s
        self._daemon = DaemonUnderTest(seed, folder, patience_s=patience_s)

    def run(self, trials: Sequence[Trial]) -> CampaignReport:
        """Run the trials, those that need a start of their own last, and return all that was found."""
        began_s = time.monotonic()
        reports: list[TrialReport] = []
        for trial in sorted(trials, key=lambda trial: trial.needs_a_start):
            reports.append(self._proven(trial))
            self._tell(reports[-1])
        self._daemon.stop()
        return CampaignReport(
            seed=self._seed,
            scenario=SCENARIO,
            seconds=time.monotonic() - began_s,
            trials=reports,
            fault_free=self._daemon.free,
            valid_share=self._daemon.free.valid_share,
            process=self._daemon.longest,
            starts=self._daemon.starts,
            hung_stops=self._daemon.hung_stops,
            held_up=self._daemon.listener.held_up,
        )

    def close(self) -> None:
        """End everything that runs."""
        self._daemon.close()

    def _proven(self, trial: Trial) -> TrialReport:
        """Return the report of a trial; one that failed while the rig itself lost frames is run again."""
        for _ in range(_ATTEMPTS - 1):
            report = self._once(trial)
            if not (report.failures and report.rig_late):
                return report
        return self._once(trial)

    def _once(self, trial: Trial) -> TrialReport:
        act = trial.faults[0].act
        try:
            if isinstance(act, Command):
                return self._command(trial, act)
            if isinstance(act, Restart):
                return self._restarted(trial, act)
            return self._running(trial)
        except UserError as error:  # the daemon died: nothing else raises this here
            self._daemon.stop()
            return _report(trial, None, [str(error)])

    def _running(self, trial: Trial) -> TrialReport:
        daemon = self._daemon
        if not daemon.settle(in_motion=trial.in_motion):
            return _report(trial, None, ["the ground does not become steadily valid"])
        late_before, before = daemon.rig_late(), daemon.counted()
        daemon.end_free()
        inject_ns = time.monotonic_ns()
        for fault in trial.faults:
            daemon.inject(fault)
        self._hold(trial, inject_ns)
        for fault in reversed(trial.faults):
            daemon.clear(fault)
        clear_ns = time.monotonic_ns()
        found = self._recovered(trial, inject_ns, clear_ns)
        late = max(0, daemon.rig_late() - late_before)  # the daemon may have been started anew
        recovered = found.recovery_s is not None
        if recovered:
            daemon.begin_free()
        daemon.listen(_HEALTH_S)
        counted = daemon.counted()
        counted.subtract(before)
        if not recovered:
            daemon.stop()
        why = list(failures(trial.expectation, found, 1e-9 * (clear_ns - inject_ns)))
        return _report(trial, found, why, counted=counted, rig_late=late)

    def _restarted(self, trial: Trial, act: Restart) -> TrialReport:
        daemon, folder = self._daemon, self._empty_folder()
        plan = act.change(daemon.plan, folder)
        if trial.faults[0].expect is Expect.REFUSED:
            return self._second_start(trial, plan)
        daemon.start(plan)
        inject_ns = time.monotonic_ns()
        if daemon.await_steady():
            inject_ns = time.monotonic_ns()
        act.then(folder)
        self._hold(trial, inject_ns)
        counted, late = daemon.counted(), daemon.rig_late()
        clear_ns = time.monotonic_ns()
        daemon.start(daemon.plan)
        found = self._recovered(trial, inject_ns, clear_ns)
        why = list(failures(trial.expectation, found, 1e-9 * (clear_ns - inject_ns)))
        return _report(trial, found, why, counted=counted, rig_late=late)

    def _empty_folder(self) -> Path:
        return Path(tempfile.mkdtemp(dir=self._folder))

    def _hold(self, trial: Trial, inject_ns: int) -> None:
        """Listen while the fault lasts; one that waits for motion is over soon after it was flagged."""
        expected, grounds = trial.expectation, self._daemon.listener.grounds

        def flagged_for_long() -> bool:
            flag_ns = next((h.t_ns for h in grounds if h.t_ns > inject_ns and h.flag), None)
            return flag_ns is not None and time.monotonic_ns() - flag_ns > _AFTER_FLAG_S * 1e9

        if expected.in_motion and expected.expect is Expect.FLAGGED:
            self._daemon.listen(trial.hold_s, flagged_for_long)
        else:
            self._daemon.listen(trial.hold_s)

    def _recovered(self, trial: Trial, inject_ns: int, clear_ns: int) -> Measured:
        expected, heard = trial.expectation, self._daemon.listener

        def again() -> bool:
            return recovery_s(heard.grounds, heard.on_can, clear_ns) is not None

        self._daemon.listen(self._patience_s, again)
        times = Times(inject_ns, clear_ns, time.monotonic_ns())
        walked_s = self._daemon.walked_s if expected.in_motion else _passed_s
        return measure(heard.grounds, heard.attitudes, heard.on_can, times, expected, walked_s)

    def _second_start(self, trial: Trial, plan: DaemonPlan) -> TrialReport:
        self._daemon.settle(in_motion=False)
        try:
            DaemonProcess(plan, carry_out).stop()
        except UserError as refusal:
            return _report(trial, None, [], told=str(refusal))
        return _report(trial, None, ["the daemon started, though it must not"])

    def _command(self, trial: Trial, act: Command) -> TrialReport:
        folder = self._empty_folder()
        command = [sys.executable, "-m", "cli.main", *act.prepare(self._daemon.plan, folder)]
        home = Path(__file__).parents[2]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_COMMAND_S, cwd=home, check=False)
        lines = done.stderr.strip().splitlines()
        why = [] if done.returncode in act.codes else [f"exit code {done.returncode}"]
        if "Traceback" in done.stderr or (done.returncode and len(lines) != 1):
            why.append(f"{len(lines)} lines of error message instead of one")
        return _report(trial, None, why, told=lines[-1] if lines else "")


def _passed_s(from_ns: int, to_ns: int) -> float:
    return 1e-9 * (to_ns - from_ns)


def _report(
    trial: Trial,
    measured: Measured | None,
    why: list[str],
    *,
    counted: "Counter[str] | None" = None,
    rig_late: int = 0,
    told: str = "",
) -> TrialReport:
    expected = trial.expectation
    return TrialReport(
        name=trial.name,
        layer=" + ".join(fault.layer.value for fault in trial.faults),
        how="; ".join(fault.how for fault in trial.faults),
        expect=expected.expect,
        limit_s=expected.limit_s,
        recovery_limit_s=expected.recovery_s,
        reason="; ".join(fault.reason for fault in trial.faults if fault.reason),
        measured=measured,
        failures=why,
        counted={name: n for name, n in sorted((counted or {}).items()) if n and name not in _ALWAYS_COUNTED},
        rig_late=rig_late,
        told=told,
    )
