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

from lab.evaluation.busy_host import Burden, ProcessorPressure
from lab.faults.catalogue import carry_out, expected_together
from lab.faults.daemon_process import DaemonPlan, DaemonProcess
from lab.faults.daemon_under_test import DaemonUnderTest
from lab.faults.fault import FOREIGN, Command, Expect, Fault, Restart
from lab.faults.report import Attempt, FaultFree, TrialReport
from lab.faults.trial import Expectation, Measured, Times, failures, measure, recovery_s
from messages import UserError
from sim_rig.camera.film import Film

_AFTER_FLAG_S = 1.5  # a fault that waits for motion lasts so long after its flag
_HEALTH_S = 1.1  # until the next health message, one a second, has come
_COMMAND_S = 60.0  # within which a command must end
_ATTEMPTS = 3  # of a trial that the host holds up
_JUDGED_S = 1.0  # for so long the host is judged before a fault that burdens it
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
    def burdens_host(self) -> bool:
        """Return whether it holds up the rig and the campaign as well."""
        return any(fault.burdens_host for fault in self.faults)

    @property
    def needs_a_start(self) -> bool:
        """Return whether the daemon does not simply run on."""
        return any(
            isinstance(f.act, Restart | Command) or (not f.touches and f.expect is Expect.SILENT) for f in self.faults
        )


class Campaign:
    """Runs trials in `folder`, an empty one, and tells `tell` of each attempt as it ends. Close it when done.

    `patience_s` is how long it waits for the ground to become steady, and steady again, before it gives up. Of the
    `film` see `DaemonUnderTest`.
    """

    def __init__(
        self,
        seed: int,
        folder: Path,
        tell: Callable[[Attempt], None],
        *,
        patience_s: float = 15.0,
        film: Film | None = None,
    ) -> None:
        self._folder = folder
        self._tell = tell
        self._patience_s = patience_s
        self._daemon = DaemonUnderTest(seed, folder, patience_s=patience_s, film=film)

    def run(self, trials: Sequence[Trial]) -> None:
        """Run the trials, those that need a start of their own last; what is held up by the host is tried again."""
        for trial in sorted(trials, key=lambda trial: trial.needs_a_start):
            for _ in range(_ATTEMPTS):
                attempt = self._attempt(trial)
                self._tell(attempt)
                if not attempt.trial.void:
                    break
        self._daemon.stop()

    def close(self) -> None:
        """End everything that runs."""
        self._daemon.close()

    def _attempt(self, trial: Trial) -> Attempt:
        """Run a trial once; all that is heard from the end of the attempt before it on is accounted for."""
        daemon, heard = self._daemon, self._daemon.listener
        began_s, wrong, held_up = time.monotonic(), daemon.wrong, heard.held_up
        starts, hung = daemon.starts, daemon.hung_stops
        report = self._once(trial)
        free, daemon.free = daemon.free, FaultFree()
        return Attempt(
            trial=report,
            seconds=time.monotonic() - began_s,
            fault_free=free,
            elsewhere=daemon.wrong - wrong - report.wrong - free.all_wrong(),
            starts=daemon.starts - starts,
            hung_stops=daemon.hung_stops - hung,
            held_up=heard.held_up - held_up,
            process=daemon.longest,
        )

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
        daemon, pressure = self._daemon, ProcessorPressure()
        if not daemon.settle(in_motion=trial.in_motion):
            void = Burden(waiting=pressure.share()).too_much or _lost(daemon.rig_late())
            return _report(trial, None, ["the ground does not become steadily valid"], void=void)
        before = daemon.counted()
        mark, void = daemon.mark(), ""
        if trial.burdens_host:
            daemon.listen(_JUDGED_S)
            void = daemon.burden(mark).too_much
        daemon.end_free()
        inject_ns = time.monotonic_ns()
        for fault in trial.faults:
            daemon.inject(fault)
        self._hold(trial, inject_ns)
        for fault in reversed(trial.faults):
            daemon.clear(fault)
        clear_ns = time.monotonic_ns()
        found = self._recovered(trial, inject_ns, clear_ns)
        recovered = found.recovery_s is not None
        burden = daemon.burden(mark)
        if recovered:
            daemon.begin_free()
        daemon.listen(_HEALTH_S)
        counted = daemon.counted()
        counted.subtract(before)
        if not recovered:
            daemon.stop()
        why = list(failures(trial.expectation, found, 1e-9 * (clear_ns - inject_ns)))
        if not trial.burdens_host:
            void = _void(burden, found, why)
        return _report(trial, found, why, counted=counted, rig_late=burden.frames_late, void=void)

    def _restarted(self, trial: Trial, act: Restart) -> TrialReport:
        daemon, folder = self._daemon, self._empty_folder()
        plan = act.change(daemon.plan, folder)
        if trial.faults[0].expect is Expect.REFUSED:
            return self._second_start(trial, plan)
        daemon.start(plan)
        inject_ns, mark = time.monotonic_ns(), daemon.mark()
        if trial.faults[0].expect is Expect.TOLERATED and daemon.await_steady():
            inject_ns, mark = time.monotonic_ns(), daemon.mark()
        act.then(folder)
        daemon.listen(trial.hold_s)
        counted, burden = daemon.counted(), daemon.burden(mark)
        clear_ns = time.monotonic_ns()
        daemon.start(daemon.plan)
        found = self._recovered(trial, inject_ns, clear_ns)
        why = list(failures(trial.expectation, found, 1e-9 * (clear_ns - inject_ns)))
        void = _void(burden, found, why)
        return _report(trial, found, why, counted=counted, rig_late=burden.frames_late, void=void)

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
        home, pressure = Path(__file__).parents[2], ProcessorPressure()
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_COMMAND_S, cwd=home, check=False)
        except subprocess.TimeoutExpired:
            void = Burden(waiting=pressure.share()).too_much
            return _report(trial, None, [f"the command did not end within {_COMMAND_S:g} s"], void=void)
        lines = done.stderr.strip().splitlines()
        if act.work is not None:
            lines = [line for line in lines if not line.startswith(f"gaiteyes: {act.work}")]
        why = [] if done.returncode in act.codes else [f"exit code {done.returncode}"]
        if "Traceback" in done.stderr or (done.returncode and len(lines) != 1):
            why.append(f"{len(lines)} lines of error message instead of one")
        return _report(trial, None, why, told=lines[-1] if lines else "")


def _void(burden: Burden, found: Measured, why: Sequence[str]) -> str:
    """Return why a trial proves nothing, if so: the host was too busy, or it failed while the rig lost frames.

    A lost frame excuses no wrong estimate.
    """
    wrong = found.wrong or found.wrong_on_can or found.wrong_attitudes
    return burden.too_much or (_lost(burden.frames_late) if why and not wrong else "")


def _lost(frames: int) -> str:
    return f"it failed while the rig lost {frames} frames" if frames else ""


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
    void: str = "",
) -> TrialReport:
    expected = trial.expectation
    return TrialReport(
        name=trial.name,
        faults=len(trial.faults),
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
        void=void,
    )
