"""The result of one case: what was hidden, what was told, and what it gained. One file each."""

from pathlib import Path

import msgspec

from lab.hidden.case import Truth
from lab.hidden.json_file import read_struct, write_struct


class ToldQuantity(msgspec.Struct, frozen=True):
    """A parameter of a verdict."""

    value: float | None
    low: float | None
    high: float | None
    unit: str


class ToldCause(msgspec.Struct, frozen=True):
    """A cause of a verdict."""

    name: str
    parameters: dict[str, ToldQuantity]
    evidence: dict[str, float | None]
    equivalents: list[str]


class Told(msgspec.Struct, frozen=True):
    """What of verdict.json is judged."""

    system: str
    verdict: str
    causes: list[ToldCause]
    next_experiment: str | None = None


class Errors(msgspec.Struct, frozen=True):
    """Held-out NRMSE of base and extended model, computed anew from held_out.csv; null where nothing was measured."""

    before: float | None
    after: float | None


class Result(msgspec.Struct, frozen=True):
    """All of one case. `told` is null where the command failed, with its last line in `failure`.

    `oracle` are the errors if the finder is told which causes to fit, of single and pair cases; of a system with ports,
    whose truth knows how much there is to be found, it is null. `seconds` is the
    command's whole run, `cpu_seconds` what it computed: on a busy machine that is less.
    """

    truth: Truth
    left_out: tuple[str, ...]
    told: Told | None
    errors: Errors | None
    oracle: Errors | None
    seconds: float
    cpu_seconds: float
    failure: str = ""

    @property
    def line(self) -> str:
        """Return the case, what was told of it, and how long that took."""
        causes = [] if self.told is None else [cause.name for cause in self.told.causes]
        verdict = self.failure if self.told is None else " ".join((self.told.verdict, *causes))
        return f"{self.truth.case_name}: {verdict} ({self.seconds:.1f} s)"

    def save(self, path: Path) -> None:
        """Write it in one piece; raises UserError where it cannot."""
        write_struct(path, self)

    @staticmethod
    def load(path: Path) -> "Result":
        """Read it back; raises UserError naming file and field."""
        return read_struct(path, Result)
