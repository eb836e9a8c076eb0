"""Runs decoders on inputs that Hypothesis draws from a seed, counts, and keeps what breaks one."""

import contextlib
import signal
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import msgspec
from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.decoders import Decoder, outcome


def longest_s(decoder: Decoder) -> int:
    """Return after how long an input is a hang, in s; a C3D file, read in a child process, has bounds of its own."""
    return 90 if decoder.name == "C3D" else 10


class HangError(Exception):
    """A decoder did not come back."""


class Tally(msgspec.Struct):
    """What became of the inputs of one decoder; `faults` are what was raised, by its first words, and an input."""

    taken: int = 0
    refused: int = 0
    faults: dict[str, bytes] = msgspec.field(default_factory=dict)

    @property
    def inputs(self) -> int:
        """Return how many there were."""
        return self.taken + self.refused


def run(decoder: Decoder, count: int, seed_number: int) -> Tally:
    """Return what becomes of `count` inputs; the same seed draws the same ones."""
    tally = Tally()

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        @seed(seed_number)
        @settings(
            max_examples=count,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(decoder.damage(decoder.samples()))
        def feed(data: bytes) -> None:
            try:
                with _bounded(longest_s(decoder)), warnings.catch_warnings():
                    warnings.simplefilter("error")
                    taken = outcome(decoder, data, folder)
            except Exception as fault:  # noqa: BLE001  # whatever it is, it is what is looked for
                tally.faults.setdefault(_words(fault), data)
                taken = False
            tally.taken += taken
            tally.refused += not taken

        feed()
    return tally


@contextlib.contextmanager
def _bounded(most_s: int) -> Iterator[None]:
    def give_up(_number: int, _frame: FrameType | None) -> None:
        raise HangError(f"took longer than {most_s} s")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(most_s)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _words(fault: Exception) -> str:
    """Return the kind of a fault and the innermost line of the project at which it came."""
    place, trace = "", fault.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_code.co_filename
        if "site-packages" not in name and "/tests/" not in name:
            place = f"{Path(name).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return f"{type(fault).__name__} at {place}: {' '.join(str(fault).split())[:120]}"
