"""Recorded inputs through the pipeline, every estimate to a file of JSON lines."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO, Protocol, TypeVar

import msgspec

from daemon.pipeline import Pipeline
from messages import TOPIC_OF, Estimate, GroundPlane, Input, UserError
from messages.codec import encode_line

T = TypeVar("T")


class Replayed(msgspec.Struct, frozen=True, kw_only=True):
    """The ground estimates of a replay, and how many estimates there were of each topic."""

    grounds: list[GroundPlane]
    estimates: dict[str, int]


class ReplayObserver(Protocol):
    """Sees what goes into the pipeline and what comes out of it, in their order."""

    def add_input(self, message: Input) -> None:
        """Take one input before the pipeline does."""

    def add_estimate(self, estimate: Estimate) -> None:
        """Take one estimate."""


def replay(
    inputs: Iterable[Input], pipeline: Pipeline, out: Path | None, observers: Sequence[ReplayObserver] = ()
) -> Replayed:
    """Drive `pipeline` with `inputs`; write each estimate as one JSON object a line to `out`.

    Raises UserError where `out` cannot be written.
    """
    grounds: list[GroundPlane] = []
    counts: Counter[str] = Counter()
    with ExitStack() as stack:
        lines = None if out is None else stack.enter_context(_Lines(out))
        for message in inputs:
            for observer in observers:
                observer.add_input(message)
            for estimate in pipeline.step(message):
                topic = TOPIC_OF[type(estimate)]
                counts[topic.name] += 1
                for observer in observers:
                    observer.add_estimate(estimate)
                if isinstance(estimate, GroundPlane):
                    grounds.append(estimate)
                if lines is not None:
                    lines.write(encode_line(topic, estimate))
    return Replayed(grounds=grounds, estimates=dict(counts))


class _Lines:
    """A file of lines; what goes wrong with it is told as one line that names it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO = self._told(lambda: path.open("wb"))

    def __enter__(self) -> "_Lines":
        return self

    def __exit__(self, *_: object) -> None:
        self._told(self._file.close)

    def write(self, line: bytes) -> None:
        self._told(lambda: self._file.write(line + b"\n"))

    def _told(self, act: Callable[[], T]) -> T:
        try:
            return act()
        except OSError as error:
            raise UserError(f"{self._path}: {error.strerror}") from error
