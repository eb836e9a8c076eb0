"""How far a long work is: a bar or a status at a terminal; elsewhere lines on stderr, for whoever follows a log."""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from rich.live import Live
from rich.progress import track
from rich.text import Text

from cli.console import console

T = TypeVar("T")
Clock = Callable[[], float]

LINE_EVERY_S = 10.0
"""A log that is followed is neither silent for long nor full of these lines."""


def progress(items: Sequence[T], what: str) -> Iterator[T]:
    """Yield `items`, telling how many of them are done."""
    return counted(items, len(items), what)


def counted(items: Iterable[T], total: int, what: str, clock: Clock = time.monotonic) -> Iterator[T]:
    """Yield `items`, of which there are `total`, telling how many of them are done."""
    if console.is_terminal:
        yield from track(items, description=what, total=total, console=console)
        return
    _tell(f"{what}: 0 of {total}")
    start_s = told_s = clock()
    for done, item in enumerate(items, start=1):
        yield item
        now_s = clock()
        if now_s - told_s >= LINE_EVERY_S:
            told_s = now_s
            _tell(f"{what}: {done} of {total}, {_duration(now_s - start_s)}")


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """Tell that work of unknown length goes on, `what` it is and for how long; the result takes the next thing."""
    if console.is_terminal:
        with console.status(what) as status:
            yield status.update
        return
    start_s, now = time.monotonic(), [what]
    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(LINE_EVERY_S):
            _tell(f"{now[0]}, {_duration(time.monotonic() - start_s)}")

    def update(what: str) -> None:
        now[0] = what
        _tell(what)

    _tell(what)
    teller = threading.Thread(target=tell, name="progress", daemon=True)
    teller.start()
    try:
        yield update
    finally:
        ended.set()
        teller.join()


def passing(items: Iterable[T], tell: Callable[[str], None], what: str, clock: Clock = time.monotonic) -> Iterator[T]:
    """Yield `items`, of which nobody knows how many there are, and `tell` once in LINE_EVERY_S how many have passed."""
    told_s = clock()
    for done, item in enumerate(items):
        now_s = clock()
        if now_s - told_s >= LINE_EVERY_S:
            told_s = now_s
            tell(f"{what}: {done:,} so far")
        yield item


class LiveLine:
    """One line that is kept up to date: in its place at a terminal, else printed every ten seconds at most."""

    def __init__(self) -> None:
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        self._told_s = -math.inf

    def __enter__(self) -> "LiveLine":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def tell(self, line: str) -> None:
        """Show `line` in place of the one before."""
        if self._live is not None:
            self._live.update(Text(line), refresh=True)
        elif time.monotonic() - self._told_s >= LINE_EVERY_S:
            self._told_s = time.monotonic()
            console.print(line, soft_wrap=True)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} min" if minutes else f"{rest} s"


def _tell(line: str) -> None:
    print(f"gaiteyes: {line}", file=sys.stderr, flush=True)
