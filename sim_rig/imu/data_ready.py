"""The host's end of the chip's INT pin, in real or simulated time: late interrupts, lost edges, a broken wire."""

import errno
import os
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

_TYPICAL_LATENCY_S = 20e-6
_GIVEN_UP_S = 0.1


class EdgeSource(Protocol):
    """The chip as the pin shows it."""

    def take_edges(self) -> list[int]:
        """Return the instants of the edges since the last call, ns, oldest first."""

    def next_edge_ns(self) -> int | None:
        """Return when the next edge will be; None if there will be none."""


class SimulatedDataReady:
    """The INT pin of `chip` as `drivers.protocols.DataReadyLine`.

    A stamp is late by 20 µs (exponential), and for the share `late_share` of edges by up to `latest_s`; both may be
    changed while it runs. Nothing is seen before its stamp. `lose` makes the next edges vanish, `cut` all from then on,
    `take_away` makes `wait` raise OSError (ENODEV), as when the GPIO chip is unplugged. `sleep` waits in real time, or
    lets simulated time pass.
    """

    def __init__(
        self,
        chip: EdgeSource,
        clock: Callable[[], int],
        sleep: Callable[[float], None],
        seed: int,
        *,
        late_share: float = 0.01,
        latest_s: float = 0.003,
    ) -> None:
        self._chip = chip
        self._clock = clock
        self._sleep = sleep
        self._rng = np.random.default_rng([seed, 8])
        self.late_share = late_share
        self.latest_s = latest_s
        self._stamped: list[int] = []
        self._to_lose = 0
        self._is_cut = False
        self._is_away = False

    def open(self) -> "SimulatedDataReady":
        """Return the line itself, empty, as a driver opens it. Raises OSError (ENODEV) while it is taken away."""
        self._fail_if_away()
        self._collect()
        self._stamped.clear()
        return self

    def lose(self, edges: int) -> None:
        """Let the next `edges` edges vanish."""
        self._to_lose += edges

    def cut(self, cut: bool = True) -> None:
        """Break the wire, or mend it."""
        self._is_cut = cut

    def take_away(self, away: bool = True) -> None:
        """Unplug the GPIO chip, or plug it in again."""
        self._is_away = away

    def wait(self, timeout_s: float) -> Sequence[int]:
        """Return the stamps of all waiting edges, oldest first; empty if none came in time."""
        end_ns = self._clock() + round(timeout_s * 1e9)
        while True:
            self._fail_if_away()
            self._collect()
            now_ns = self._clock()
            seen = [t_ns for t_ns in self._stamped if t_ns <= now_ns]
            if seen or now_ns >= end_ns:
                del self._stamped[: len(seen)]
                return seen
            self._sleep((min(end_ns, self._until_ns(now_ns)) - now_ns) * 1e-9)

    def close(self) -> None:
        """Release the line."""

    def _fail_if_away(self) -> None:
        if self._is_away:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def _until_ns(self, now_ns: int) -> int:
        """Return when there may be something new: the next stamp, or the chip's next edge."""
        if self._stamped:
            return self._stamped[0]
        edge_ns = self._chip.next_edge_ns()
        return now_ns + round(_GIVEN_UP_S * 1e9) if edge_ns is None else max(edge_ns, now_ns + 1)

    def _collect(self) -> None:
        for edge_ns in self._chip.take_edges():
            if self._is_cut:
                continue
            if self._to_lose:
                self._to_lose -= 1
                continue
            earliest_ns = self._stamped[-1] if self._stamped else 0
            self._stamped.append(max(edge_ns + round(self._latency_s() * 1e9), earliest_ns))

    def _latency_s(self) -> float:
        if self._rng.random() < self.late_share:
            return float(self._rng.uniform(0.0, self.latest_s))
        return float(self._rng.exponential(_TYPICAL_LATENCY_S))
