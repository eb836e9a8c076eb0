"""The receiving end of estimates on CAN, as an ankle controller should do it: `CanReceiver`.

It is the reference for a microcontroller's own code, which gets its codec from `cantools generate_c_source`
and everything else from the comments and attributes of `gaiteyes.dbc`.
"""

from typing import Generic, TypeVar

from messages.can_estimates import PAIRS, CanEstimate, PairOfFrames, Told
from messages.can_frames import Fields, can_id, decode, profile
from messages.e2e import E2eCheck, E2eReceiver
from messages.estimates import Source
from messages.reasons import Reason, Status
from messages.refusal import Refusal

MAX_TOLD_AGE_S = 0.254
MIN_SPACING_CYCLES = 0.25

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
        self._max_age_s = self._pair.topic.deadline_s if max_age_s is None else max_age_s
        if not 0.0 < self._max_age_s < MAX_TOLD_AGE_S:
            raise ValueError(
                f"max_age_s: {max_age_s} is not between 0 and {MAX_TOLD_AGE_S} s, the oldest age a frame tells"
            )
        self.reason: str = Reason.NONE.value
        self._accepted = set(Source) if accept_simulated else {Source.LIVE}
        self._messages = {can_id(message): message for message in (self._pair.first, self._pair.second)}
        self._checks = {message: E2eReceiver(profile(message)) for message in self._messages.values()}
        self._min_spacing_ns = round(1e9 * MIN_SPACING_CYCLES * profile(self._pair.first).cycle_s)
        self._t_first_ns: int | None = None
        self._first_half: tuple[Fields, int] | None = None

    @property
    def can_ids(self) -> tuple[int, ...]:
        """Return the identifiers of the frames that are read."""
        return tuple(self._messages)

    def feed(self, frame_id: int, data: bytes, t_ns: int) -> R | Refusal:
        """Take one frame received at `t_ns`; return the estimate it completes, or why there is none."""
        message = self._messages.get(frame_id)
        if message is None:
            return Refusal.OTHER_MESSAGE
        is_first, last_ns = message is self._pair.first, self._t_first_ns
        if is_first:
            self._t_first_ns = t_ns
        check = self._checks[message].check(data, t_ns)
        if check is not E2eCheck.OK:
            return Refusal(check.value)
        fields = decode(message, data)
        if is_first:
            too_soon = last_ns is not None and t_ns - last_ns < self._min_spacing_ns
            self._first_half = None if too_soon else (fields, t_ns)
            return Refusal.TOO_SOON if too_soon else Refusal.FIRST_HALF
        first_half, self._first_half = self._first_half, None
        if first_half is None or first_half[0].numbers["frame_number"] != fields.numbers["frame_number"]:
            return Refusal.FRAME_MISMATCH
        return self._check_pair(first_half[0], fields, first_half[1], t_ns)

    def _check_pair(self, first: Fields, second: Fields, t_first_ns: int, t_ns: int) -> R | Refusal:
        words, numbers = first.words | second.words, first.numbers | second.numbers
        if words["source"] not in self._accepted:
            return Refusal.NOT_LIVE
        if words["status"] != Status.VALID:
            self.reason = words["reason"]
            return Refusal.NOT_VALID
        age_at_first_s = 1e-3 * numbers["age_ms"]
        age_s = age_at_first_s + 1e-9 * (t_ns - t_first_ns)
        if not age_s <= self._max_age_s:  # so written, an unknown age (NaN) is refused too
            return Refusal.STALE
        told = Told(t_first_ns - round(1e9 * age_at_first_s), age_s, Source(words["source"]), words, numbers)
        estimate = self._pair.read(told)
        if estimate is None:
            return Refusal.NOT_AVAILABLE
        self.reason = words["reason"]
        return estimate
