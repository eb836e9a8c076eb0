"""When did the chip take its samples? Bounds from polling and from interrupts, intersected until they are tight.

The host only ever learns that, at some instant of a transfer, the chip's newest sample was number k. That bounds the
instants t_k of two samples, with no assumption on how late a poll or a thread was:

    t_k ≤ end of the transfer            t_k+1 > its beginning

The samples lie on a line t_k = t_0 + k·T. For a period T all bounds together leave t_0 the corridor

    [L(T), U(T)],   L(T) = max(begin_k − k·T),   U(T) = min(end_k − k·T)

whose width is concave in T. So the possible periods are one interval, found by bisection, and within some seconds
of polls at all phases it shrinks to parts in 10⁵. The estimate is the middle of the interval and of the corridor
there; the ends of both say which samples are surely, possibly or surely not complete at a given time.

Where the data-ready interrupt is stamped, each stamp is one more upper bound of its own sample: it may be late, never
early. Most stamps are late by microseconds, some by milliseconds, and of several in a row the promptest is almost
surely one of the former. So the promptest of eight, less 60 µs, is taken as a lower bound too: the corridor becomes as
narrow as that. Stamps that are missing only make it know less.

Bounds that allow no line at all, because the chip's clock drifts or one of them was false after all, are looked at
through a shorter window, down to half a second.

Samples count from 1; times are integer nanoseconds of one host clock. The module reads no clock.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray

_WINDOW_S = 10.0  # longer averages more, shorter follows a clock that drifts
_SHORTEST_WINDOW_S = 0.5
_PERIOD_TOLERANCE = 0.04
_SLACK = 0.02  # of a period: what the line may bend away from its bounds until it is laid anew
_DRIFTING_SLACK = 0.08  # the same of a clock that drifts so much that the longest window does not fit
_BEND = 0.005  # of a period: bounds that exclude each other by more than this are looked at through a shorter window
_CONTRADICTION = 0.10  # of a period: bounds that exclude each other by twice this belong to two lines
_REFUTED = 0.02  # of a period: a bound that excludes the line by more has it laid anew at once
_FIT_EVERY = 25  # samples
_FIT_EACH_UNTIL = 100  # samples after a start
_BISECTIONS = 20
_PROMPT_OF = 8
_PROMPTNESS_NS = 60_000
_EDGE_EARLY = 0.2  # of a period: how much too late the line may be when an interrupt is assigned to its sample


class _Bounds:
    """The newest bounds, for each sample the tightest only, in a ring."""

    def __init__(self, size: int, tightest: Callable[[int, int], int]) -> None:
        self._tightest = tightest
        self._index = np.full(size, -1, dtype=np.int64)
        self._t_ns = np.zeros(size, dtype=np.int64)

    def put(self, index: int, t_ns: int) -> None:
        slot = index % self._index.size
        if self._index[slot] == index:
            t_ns = self._tightest(t_ns, int(self._t_ns[slot]))
        self._index[slot] = index
        self._t_ns[slot] = t_ns

    def clear(self) -> None:
        self._index[:] = -1

    def relative_to(self, index: int, t_ns: int, window: int) -> tuple[FloatArray, FloatArray]:
        """Return (n,) sample offsets and (n,) times in ns, of the bounds within `window` samples before `index`."""
        used = self._index > max(-1, index - window)
        return (self._index[used] - index).astype(np.float64), (self._t_ns[used] - t_ns).astype(np.float64)


@dataclass(frozen=True)
class _Corridor:
    """All bounds, in samples and ns relative to the newest sample and to some instant."""

    k_upper: FloatArray
    t_upper: FloatArray
    k_lower: FloatArray
    t_lower: FloatArray

    def at(self, period_ns: float) -> tuple[float, float]:
        """Return L and U of the newest sample's instant; L > U if this period is impossible."""
        lower = np.max(self.t_lower - self.k_lower * period_ns)
        return float(lower), float(np.min(self.t_upper - self.k_upper * period_ns))

    def is_possible(self, period_ns: float) -> bool:
        lower, upper = self.at(period_ns)
        return lower <= upper

    def widest(self, shortest_ns: float, longest_ns: float) -> float:
        """Return a possible period, or if there is none the one where the bounds exclude each other least."""
        while True:
            period_ns = 0.5 * (shortest_ns + longest_ns)
            if longest_ns - shortest_ns < 1e-9 * period_ns or self.is_possible(period_ns):
                return period_ns
            tightest_upper = np.argmin(self.t_upper - self.k_upper * period_ns)
            tightest_lower = np.argmax(self.t_lower - self.k_lower * period_ns)
            if self.k_lower[tightest_lower] > self.k_upper[tightest_upper]:
                shortest_ns = period_ns
            else:
                longest_ns = period_ns

    def last_possible(self, possible_ns: float, limit_ns: float) -> float:
        """Return the end of the possible periods from one of them towards `limit_ns`."""
        for _ in range(_BISECTIONS):
            middle_ns = 0.5 * (possible_ns + limit_ns)
            if self.is_possible(middle_ns):
                possible_ns = middle_ns
            else:
                limit_ns = middle_ns
        return limit_ns


@dataclass(frozen=True)
class _Line:
    """The chip's line as known at sample `index`: the middle, and the earliest and latest that are possible."""

    index: int
    t_ns: int
    period_ns: float
    earliest_ns: float
    shortest_ns: float
    latest_ns: float
    longest_ns: float

    def instant_ns(self, index: int) -> int:
        return self.t_ns + round((index - self.index) * self.period_ns)

    def latest_instant_ns(self, index: int) -> int:
        return math.ceil(self.latest_ns + (index - self.index) * self.longest_ns)

    def completed(self, t_ns: int) -> int:
        return self.index + math.floor((t_ns - self.t_ns) / self.period_ns)

    def surely_completed(self, t_ns: int) -> int:
        return self.index + math.floor((t_ns - self.latest_ns) / self.longest_ns)

    def possibly_completed(self, t_ns: int) -> int:
        return self.index + math.floor((t_ns - self.earliest_ns) / self.shortest_ns)


class SampleClock:
    """Estimates the period and phase of a chip's samples from what polling, and its interrupts if any, reveal.

    `nominal_period_s` is the period the chip was set to; the true one may differ by up to 4 %.
    """

    def __init__(self, nominal_period_s: float) -> None:
        self._nominal_ns = nominal_period_s * 1e9
        self._period_ns = self._nominal_ns
        self._longest_window = math.ceil(_WINDOW_S / nominal_period_s)
        self._shortest_window = math.ceil(_SHORTEST_WINDOW_S / nominal_period_s)
        self._window = self._longest_window
        self._upper = _Bounds(self._longest_window, min)
        self._lower = _Bounds(self._longest_window, max)
        self._edges: list[tuple[int, int]] = []
        self._prompt_of = 1
        self._line: _Line | None = None
        self._is_refuted = False
        self._count = 0
        self._first_count = 0
        self._last_stamp_ns: int | None = None

    @property
    def period_s(self) -> float:
        """Return the estimated period of the chip."""
        return self._period_ns * 1e-9

    @property
    def uncertainty_s(self) -> float:
        """Return half the span of the newest sample's possible instants; infinite before the first sample."""
        return math.inf if self._line is None else 0.5e-9 * (self._line.latest_ns - self._line.earliest_ns)

    def pending_at(self, index: int, t_ns: int) -> None:
        """Learn that sample `index`, the next one, was not complete yet at `t_ns`.

        Left out if it surely should have been: then the chip has stopped, which says nothing about its pace.
        """
        if self.missed(index - 1, t_ns) == 0:
            self._not_before(index, t_ns)

    def completed_by(self, index: int, t_ns: int) -> None:
        """Learn that sample `index`, the newest, was complete at `t_ns`; tell first what was pending."""
        self._not_after(index, t_ns)
        self._count = index
        young = index - self._first_count <= _FIT_EACH_UNTIL
        if self._line is None or young or self._is_refuted or index - self._line.index >= _FIT_EVERY:
            self._fit(t_ns)
            self._is_refuted = False

    def edge_at(self, index: int, t_ns: int) -> None:
        """Learn that the interrupt of sample `index` was stamped `t_ns`; before `completed_by` tells of that sample."""
        self._not_after(index, t_ns)
        self._edges.append((index, t_ns))
        if len(self._edges) >= self._prompt_of:
            promptest, prompt_ns = min(self._edges, key=lambda edge: edge[1] - edge[0] * self._period_ns)
            self._not_before(promptest, prompt_ns - _PROMPTNESS_NS)
            self._edges.clear()
            self._prompt_of = min(2 * self._prompt_of, _PROMPT_OF)

    def edge_index(self, t_ns: int) -> int | None:
        """Return which sample's interrupt was stamped `t_ns`, up to 0.8 periods late; None while that is in doubt."""
        if self._line is None or self._line.latest_ns - self._line.earliest_ns > _EDGE_EARLY * self._period_ns:
            return None
        return self._line.completed(t_ns + round(_EDGE_EARLY * self._period_ns))

    def missed(self, count: int, t_ns: int) -> int:
        """Return how many samples beyond `count` were surely complete at `t_ns`; 0 before the first sample."""
        return 0 if self._line is None else max(0, self._line.surely_completed(t_ns) - count)

    def ambiguous_s(self, count: int, t_ns: int) -> float:
        """Return how long after `t_ns` it is sure which samples beyond `count` are complete; 0 if it is already."""
        if self._line is None:
            return 0.0
        possible = self._line.possibly_completed(t_ns)
        if possible <= max(count, self._line.surely_completed(t_ns)):
            return 0.0
        return (self._line.latest_instant_ns(possible) - t_ns) * 1e-9

    def completed_at(self, t_ns: int) -> int:
        """Return the number of the newest sample complete at `t_ns`; the last known one before the first sample."""
        return self._count if self._line is None else self._line.completed(t_ns)

    def until_mid_period_s(self, t_ns: int) -> float:
        """Return the time from `t_ns` to the next instant halfway between two samples; 0 before the first sample."""
        if self._line is None:
            return 0.0
        phase = ((t_ns - self._line.t_ns) / self._period_ns) % 1.0
        return ((0.5 - phase) % 1.0) * self.period_s

    def stamp(self, index: int) -> int:
        """Return the instant at which sample `index` was complete, in ns; strictly later than the stamp before.

        To be asked in order, each sample once, after the observation that reported it.
        """
        if self._line is None:
            raise ValueError(f"sample {index} was never observed")
        t_ns = self._line.instant_ns(index)
        if self._last_stamp_ns is not None:
            t_ns = max(t_ns, self._last_stamp_ns + round(0.5 * self._period_ns))
        self._last_stamp_ns = t_ns
        return t_ns

    def skip_to(self, count: int) -> None:
        """Continue the same line after the samples up to `count` were discarded unseen."""
        self._count = count

    def restart(self, count: int, t_ns: int) -> None:
        """Begin a new line: the chip was restarted and had completed `count` samples, and no more, at `t_ns`."""
        self._forget(count)
        self.pending_at(count + 1, t_ns)

    def _forget(self, count: int) -> None:
        self._upper.clear()
        self._lower.clear()
        self._edges.clear()
        self._prompt_of = 1
        self._window = self._longest_window
        self._line = None
        self._count = self._first_count = count

    def _not_after(self, index: int, t_ns: int) -> None:
        self._upper.put(index, t_ns)
        if self._line is not None and self._line.instant_ns(index) - t_ns > _REFUTED * self._nominal_ns:
            self._is_refuted = True

    def _not_before(self, index: int, t_ns: int) -> None:
        self._lower.put(index, t_ns)
        if self._line is not None and t_ns - self._line.instant_ns(index) > _REFUTED * self._nominal_ns:
            self._is_refuted = True

    def _fit(self, t_ns: int) -> None:
        """Lay the line anew; begin from the newest sample alone if even the newest bounds contradict each other."""
        window = min(2 * self._window, self._longest_window)
        while not self._lay(window, t_ns, _BEND):
            if window <= self._shortest_window:
                if not self._lay(window, t_ns, 2.0 * _CONTRADICTION):
                    self._begin_from_newest(t_ns)
                return
            window //= 2
        self._window = window

    def _begin_from_newest(self, t_ns: int) -> None:
        self._forget(self._count)
        self._upper.put(self._count, t_ns)
        self._lower.put(self._count, t_ns - round(self._nominal_ns))
        self._lay(self._longest_window, t_ns, _SLACK)

    def _lay(self, window: int, t_ns: int, tolerance: float) -> bool:
        """Lay the line through the middle of what the bounds of the newest `window` samples allow.

        Return False, and change nothing, if they exclude each other by more than `tolerance` periods everywhere.
        """
        k_lower, t_lower = self._lower.relative_to(self._count, t_ns, window)
        k_upper, t_upper = self._upper.relative_to(self._count, t_ns, window)
        if not (k_lower.size and k_upper.size):
            return False
        corridor = _Corridor(k_upper, t_upper, k_lower, t_lower)
        shortest_ns = self._nominal_ns * (1.0 - _PERIOD_TOLERANCE)
        longest_ns = self._nominal_ns * (1.0 + _PERIOD_TOLERANCE)
        period_ns = corridor.widest(shortest_ns, longest_ns)
        if corridor.is_possible(period_ns):
            shortest_ns = corridor.last_possible(period_ns, shortest_ns)
            longest_ns = corridor.last_possible(period_ns, longest_ns)
            period_ns = 0.5 * (shortest_ns + longest_ns)
        else:
            shortest_ns = longest_ns = period_ns
        lower, upper = corridor.at(period_ns)
        if lower - upper > tolerance * self._nominal_ns:
            return False
        edges = (*corridor.at(shortest_ns), *corridor.at(longest_ns))
        slack_ns = (_SLACK if window == self._longest_window else _DRIFTING_SLACK) * self._nominal_ns
        self._period_ns = period_ns
        self._line = _Line(
            index=self._count,
            t_ns=t_ns + round(0.5 * (lower + upper)),
            period_ns=period_ns,
            earliest_ns=t_ns + min(edges) - slack_ns,
            shortest_ns=shortest_ns,
            latest_ns=t_ns + max(edges) + slack_ns,
            longest_ns=longest_ns,
        )
        return True
