"""The receiving end of estimates on CAN, as an ankle controller should do it: `CanReceiver`.

It is the reference for a microcontroller's own code, which gets its codec from `cantools generate_c_source`
and everything else from the comments and attributes of `gaiteyes.dbc`.
"""

from typing import Generic, TypeVar

from messages.can_checks import FrameChecks
from messages.can_estimates import PAIRS, CanEstimate, PairOfFrames, Told
from messages.can_frames import Fields, decode
from messages.estimates import Source
from messages.reasons import Reason, Status
from messages.refusal import Refusal

R = TypeVar("R", bound=CanEstimate)


class CanReceiver(Generic[R]):
    """Turns the frames of a bus, in their order of arrival, into estimates of one kind that may be acted upon.

    A pair counts only if both halves pass E2E profile 2, carry one frame number, come from a live device (or
    `accept_simulated`, which takes replays too), are valid and complete, and are not older than `max_age_s` when the
    second half arrives; without a `max_age_s` that is the deadline of the topic. `reason` is the word the last matching
    pair carried. Raises ValueError for a `max_age_s` that a frame cannot prove.

    The age in a frame ends at the sender. Frames that then wait in the queue of a stuck bus come out later as a burst
    after a silence: the first is refused as INITIAL, the others as TOO_SOON, until the sender's rhythm is back.

    Corruption that goes unnoticed: of frames hit at random 1 in 256, times the 3 (of carried grounds 6) of 16 counters
    that may come next (`messages.e2e`).
    """

    def __init__(self, kind: type[R], *, max_age_s: float | None = None, accept_simulated: bool = False) -> None:
        self._pair: PairOfFrames[R] = PAIRS[kind]
        messages = (self._pair.first, self._pair.second)
        self._checks = FrameChecks(messages, self._pair.topic, max_age_s, accept_simulated=accept_simulated)
        self.reason: str = Reason.NONE.value
        self._first_half: tuple[Fields, int] | None = None

    @property
    def can_ids(self) -> tuple[int, ...]:
        """Return the identifiers of the frames that are read."""
        return tuple(self._checks.messages)

    def feed(self, frame_id: int, data: bytes, t_ns: int) -> R | Refusal:
        """Take one frame received at `t_ns`; return the estimate it completes, or why there is none."""
        message = self._checks.messages.get(frame_id)
        if message is None:
            return Refusal.OTHER_MESSAGE
        is_first = message is self._pair.first
        too_soon = is_first and self._checks.too_soon(message, t_ns)
        refusal = self._checks.refusal(message, data, t_ns)
        if refusal is not None:
            return refusal
        fields = decode(message, data)
        if is_first:
            self._first_half = None if too_soon else (fields, t_ns)
            return Refusal.TOO_SOON if too_soon else Refusal.FIRST_HALF
        first_half, self._first_half = self._first_half, None
        if first_half is None or first_half[0].numbers["frame_number"] != fields.numbers["frame_number"]:
            return Refusal.FRAME_MISMATCH
        return self._check_pair(first_half[0], fields, first_half[1], t_ns)

    def _check_pair(self, first: Fields, second: Fields, t_first_ns: int, t_ns: int) -> R | Refusal:
        words, numbers = first.words | second.words, first.numbers | second.numbers
        if words["source"] not in self._checks.accepted:
            return Refusal.NOT_LIVE
        if words["status"] != Status.VALID:
            self.reason = words["reason"]
            return Refusal.NOT_VALID
        age_at_first_s = 1e-3 * numbers["age_ms"]
        age_s = age_at_first_s + 1e-9 * (t_ns - t_first_ns)
        if not age_s <= self._checks.max_age_s:  # so written, an unknown age (NaN) is refused too
            return Refusal.STALE
        told = Told(t_first_ns - round(1e9 * age_at_first_s), age_s, Source(words["source"]), words, numbers)
        estimate = self._pair.read(told)
        if estimate is None:
            return Refusal.NOT_AVAILABLE
        self.reason = words["reason"]
        return estimate
