"""The newest seconds of a recording, kept in memory until it is closed, and packed so that 30 s fit.

A picture hardly compresses as it is: its noise does not. The differences of neighbouring pixels take about half the
bits, and zstd's fastest level finds that at 7 % of a core for two pictures of 1280×720 at 20 frames/s. Unpacked, every
byte is the one that came.
"""

import logging
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import zstandard

from daemon.recording_file import Entry, Recordable
from messages import LastingInput

log = logging.getLogger("gaiteyes")

_LEAST_PACKED_BYTES = 4096
_LEVEL = 1


class _Kept(NamedTuple):
    """The entries of one message; the data of those whose place is in `packed` are compressed differences."""

    kind: type[Recordable]
    entries: tuple[Entry, ...]
    packed: frozenset[int]

    @property
    def log_time_ns(self) -> int:
        return self.entries[0].log_time_ns

    @property
    def size(self) -> int:
        return sum(len(entry.data) for entry in self.entries)


class RecordingRing:
    """The messages logged within `last_s` of the newest, packed, and no more than `limit_bytes` of them.

    Before them stands the newest of each kind of decision that still holds when they begin. Where `last_s` do not fit
    the oldest leave early; that is said once.
    """

    def __init__(self, last_s: float, limit_bytes: int) -> None:
        self._last_ns = round(last_s * 1e9)
        self._limit_bytes = limit_bytes
        self._bytes = 0
        self._messages: deque[_Kept] = deque()
        self._lasting: dict[type[Recordable], _Kept] = {}
        self._packer = zstandard.ZstdCompressor(level=_LEVEL)
        self._unpacker = zstandard.ZstdDecompressor()
        self._shortened = False
        self._emptied_s: float | None = None

    @property
    def span_s(self) -> float:
        """Return how many seconds the ring holds, or held when it was emptied."""
        if self._emptied_s is not None or not self._messages:
            return self._emptied_s or 0.0
        return (self._messages[-1].log_time_ns - self._messages[0].log_time_ns) * 1e-9

    def append(self, kind: type[Recordable], entries: tuple[Entry, ...]) -> None:
        """Keep the entries of one message, and let go of what is too old."""
        kept = self._pack(kind, entries)
        self._messages.append(kept)
        self._bytes += kept.size
        first_ns = kept.log_time_ns - self._last_ns
        while self._messages and (self._messages[0].log_time_ns < first_ns or self._bytes > self._limit_bytes):
            if self._messages[0].log_time_ns >= first_ns and not self._shortened:
                self._shortened = True
                log.warning(
                    "the newest %g s of these pictures take more than %d MB: the recording keeps the newest %.1f s",
                    1e-9 * self._last_ns,
                    self._limit_bytes >> 20,
                    self.span_s,
                )
            gone = self._messages.popleft()
            self._bytes -= gone.size
            if issubclass(gone.kind, LastingInput):
                self._lasting[gone.kind] = gone

    def emptied(self) -> Iterator[tuple[type[Recordable], tuple[Entry, ...]]]:
        """Yield all messages as they came, each gone from the ring when the next is asked for."""
        self._emptied_s = self.span_s
        for kept in self._lasting.values():
            yield kept.kind, self._unpacked(kept)
        self._lasting.clear()
        while self._messages:
            kept = self._messages.popleft()
            yield kept.kind, self._unpacked(kept)

    def _pack(self, kind: type[Recordable], entries: tuple[Entry, ...]) -> _Kept:
        found = list(entries)
        packed = set[int]()
        for place, entry in enumerate(entries):
            if len(entry.data) >= _LEAST_PACKED_BYTES:
                data = self._packer.compress(_differences(entry.data).data)
                if len(data) < len(entry.data):
                    found[place] = entry._replace(data=data)
                    packed.add(place)
        return _Kept(kind, tuple(found), frozenset(packed))

    def _unpacked(self, kept: _Kept) -> tuple[Entry, ...]:
        return tuple(
            entry._replace(data=_summed(self._unpacker.decompress(entry.data))) if place in kept.packed else entry
            for place, entry in enumerate(kept.entries)
        )


def _differences(data: bytes) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """Return each byte less the one before it, modulo 256."""
    values = np.frombuffer(data, dtype=np.uint8)
    return np.concatenate((values[:1], values[1:] - values[:-1]))


def _summed(data: bytes) -> bytes:
    """Return the bytes whose differences `data` are."""
    return np.cumsum(np.frombuffer(data, dtype=np.uint8), dtype=np.uint8).tobytes()
