"""What a campaign found, for a program and for a table."""

from collections.abc import Sequence

import msgspec

from lab.faults.criteria import Wrong
from lab.faults.fault import Expect
from lab.faults.trial import Measured


class TrialReport(msgspec.Struct, frozen=True, kw_only=True):
    """One fault, or two at once. `failures` is empty where all was as expected; `counted` is what health counted.

    `void` says why the trial proves nothing: the host held it up. `rig_late`: frames that the rig itself lost
    meanwhile. `measured` is None where a start or a command was to be refused.
    """

    name: str
    faults: int
    layer: str
    how: str
    expect: Expect
    limit_s: float
    recovery_limit_s: float
    reason: str
    measured: Measured | None
    failures: list[str]
    counted: dict[str, int]
    rig_late: int
    told: str = ""
    void: str = ""

    @property
    def verdict(self) -> str:
        """Return `void`, `FAIL`, `pass` or, for the undetectable, `listed`."""
        if self.void:
            return "void"
        if self.failures:
            return "FAIL"
        return "listed" if self.expect is Expect.UNDETECTABLE else "pass"

    @property
    def wrong(self) -> Wrong:
        """Return what was wrong and marked valid in it."""
        found = self.measured
        return Wrong() if found is None else Wrong(found.wrong, found.wrong_on_can, found.wrong_attitudes)


class FaultFree(msgspec.Struct, kw_only=True):
    """What was heard while nothing was wrong, between the trials; `away` are frames without an edge at the foothold.

    `left_out_s` is the time that the host disturbed; nothing of it is counted.
    """

    seconds: float = 0.0
    left_out_s: float = 0.0
    frames: int = 0
    valid: int = 0
    away: int = 0
    away_valid: int = 0
    wrong: int = 0
    wrong_on_can: int = 0
    stale: int = 0
    wrong_attitudes: int = 0

    @property
    def valid_share(self) -> float:
        """Return the valid share of the frames; NaN without any."""
        return self.valid / self.frames if self.frames else float("nan")

    @property
    def away_valid_share(self) -> float:
        """Return the valid share of the frames away from edges; NaN without any."""
        return self.away_valid / self.away if self.away else float("nan")

    def all_wrong(self) -> Wrong:
        """Return what was wrong and marked valid in it."""
        return Wrong(self.wrong, self.wrong_on_can, self.wrong_attitudes)

    def add(self, more: "FaultFree") -> None:
        """Count `more` as well."""
        for name in self.__struct_fields__:
            setattr(self, name, getattr(self, name) + getattr(more, name))


class Process(msgspec.Struct, frozen=True, kw_only=True):
    """The daemon's process that lived longest, when its ground was first steady and at its end."""

    seconds: float
    memory_mb: tuple[float, float]
    threads: tuple[int, int]
    open_files: tuple[int, int]

    def since(self, first: "Process", seconds: float) -> "Process":
        """Return this look at a process beside the first one, `seconds` earlier."""
        return Process(
            seconds=seconds,
            memory_mb=(first.memory_mb[0], self.memory_mb[1]),
            threads=(first.threads[0], self.threads[1]),
            open_files=(first.open_files[0], self.open_files[1]),
        )


class Attempt(msgspec.Struct, frozen=True, kw_only=True):
    """One attempt at a trial, and what came since the attempt before it: a line of the campaign's file.

    `elsewhere` is what was wrong and valid neither in the trial nor in fault-free time: while a daemon started, while
    the ground became steady, or in time that the host disturbed. `held_up` messages came while the listener itself was
    held up: their age was not judged. `process` is the longest-lived daemon so far.
    """

    trial: TrialReport
    seconds: float
    fault_free: FaultFree
    elsewhere: Wrong
    starts: int
    hung_stops: int
    held_up: int
    process: Process | None


class CampaignReport(msgspec.Struct, frozen=True, kw_only=True):
    """The whole campaign: every attempt at every trial, in order; of each trial the last attempt stands.

    `elsewhere` is what was wrong neither in a trial nor in fault-free time, `disturbed` the same about void trials.
    """

    seed: int
    scenario: str
    seconds: float
    trials: list[TrialReport]
    fault_free: FaultFree
    elsewhere: Wrong
    disturbed: Wrong
    process: Process | None
    starts: int
    hung_stops: int
    held_up: int

    @classmethod
    def of(cls, seed: int, scenario: str, attempts: Sequence[Attempt]) -> "CampaignReport":
        """Return the report of these attempts."""
        free = FaultFree()
        for attempt in attempts:
            free.add(attempt.fault_free)
        processes = [attempt.process for attempt in attempts if attempt.process is not None]
        return cls(
            seed=seed,
            scenario=scenario,
            seconds=sum(attempt.seconds for attempt in attempts),
            trials=[attempt.trial for attempt in attempts],
            fault_free=free,
            elsewhere=sum((a.elsewhere for a in attempts if not a.trial.void), Wrong()),
            disturbed=sum((a.elsewhere for a in attempts if a.trial.void), Wrong()),
            process=max(processes, key=lambda process: process.seconds, default=None),
            starts=sum(attempt.starts for attempt in attempts),
            hung_stops=sum(attempt.hung_stops for attempt in attempts),
            held_up=sum(attempt.held_up for attempt in attempts),
        )

    @property
    def standing(self) -> list[TrialReport]:
        """Return the last attempt at each trial."""
        return list({trial.name: trial for trial in self.trials}.values())

    @property
    def void(self) -> list[str]:
        """Return what proves nothing: trials, though they were repeated, and fault-free time without a sound part."""
        free = self.fault_free
        disturbed = bool(free.left_out_s) and not free.frames
        return [trial.name for trial in self.standing if trial.void] + ["the time without a fault"] * disturbed

    @property
    def passed(self) -> bool:
        """Return whether no trial failed and nothing wrong was heard in fault-free time either."""
        free = self.fault_free
        sound = not (free.all_wrong() or self.elsewhere or free.stale or self.hung_stops)
        return sound and not any(trial.verdict == "FAIL" for trial in self.standing)

    def all_wrong(self) -> Wrong:
        """Return all that was wrong and marked valid, wherever it was heard."""
        between = self.fault_free.all_wrong() + self.elsewhere + self.disturbed
        return sum((trial.wrong for trial in self.trials), between)
