"""What a campaign found, for a program and for a table."""

import msgspec

from lab.faults.fault import Expect
from lab.faults.trial import Measured


class TrialReport(msgspec.Struct, frozen=True, kw_only=True):
    """One fault, or two at once. `failures` is empty where all was as expected; `counted` is what health counted.

    `rig_late`: frames that the rig itself lost meanwhile; the trial proves less then. `measured` is None where
    a start or a command was to be refused.
    """

    name: str
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

    @property
    def verdict(self) -> str:
        """Return `pass`, `FAIL` or, for the undetectable, `listed`."""
        if self.failures:
            return "FAIL"
        return "listed" if self.expect is Expect.UNDETECTABLE else "pass"


class FaultFree(msgspec.Struct, kw_only=True):
    """What was heard while nothing was wrong, between the trials."""

    seconds: float = 0.0
    frames: int = 0
    valid: int = 0
    wrong: int = 0
    stale: int = 0
    wrong_attitudes: int = 0

    @property
    def valid_share(self) -> float:
        """Return the valid share of the frames; NaN without any."""
        return self.valid / self.frames if self.frames else float("nan")


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


class CampaignReport(msgspec.Struct, frozen=True, kw_only=True):
    """The whole campaign. `held_up` messages came while the listener itself was held up: their age was not judged."""

    seed: int
    scenario: str
    seconds: float
    trials: list[TrialReport]
    fault_free: FaultFree
    valid_share: float
    process: Process | None
    starts: int
    hung_stops: int
    held_up: int

    @property
    def passed(self) -> bool:
        """Return whether every trial ended as it must and nothing wrong was heard in fault-free time either."""
        free = self.fault_free
        sound = not (free.wrong or free.wrong_attitudes or free.stale or self.hung_stops)
        return sound and all(not trial.failures for trial in self.trials)
