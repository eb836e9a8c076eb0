"""The receiving end of the ground on CAN, as an ankle controller should do it: `GroundReceiver`.

It is the reference for a microcontroller's own code, which gets its codec from `cantools generate_c_source`
and everything else from the comments and attributes of `gaiteyes.dbc`.
"""

import math

import msgspec

from messages.can_frames import CanMessage, Fields, can_id, decode, profile
from messages.e2e import E2eCheck, E2eReceiver
from messages.estimates import Source
from messages.reasons import Reason, Status
from messages.refusal import Refusal
from messages.topics import TOPICS

MAX_TOLD_AGE_S = 0.254
MIN_SPACING_CYCLES = 0.25


class ReceivedGround(msgspec.Struct, frozen=True, kw_only=True):
    """One estimate as two matching frames told it; angles in rad, lengths in m, in the heading frame H.

    `t_exposure_ns` is on the receiver's own clock: reception of the first half minus the age it carried.
    `calibration_id` is the first three of eight hexadecimal digits.
    """

    t_exposure_ns: int
    age_s: float
    source: Source
    slope_sagittal_rad: float
    slope_frontal_rad: float
    height_m: float
    slope_sagittal_sd_rad: float
    slope_frontal_sd_rad: float
    height_sd_m: float
    calibration_id: str


class GroundReceiver:
    """Turns the frames of a bus, in their order of arrival, into estimates that may be acted upon.

    A pair counts only if both halves pass E2E profile 2, carry one frame number, come from a live device (or
    `accept_simulated`, which takes replays too), are valid and complete, and are not older than `max_age_s` when the
    second half arrives. `reason` is the word the last matching pair carried. Raises ValueError for a `max_age_s` that
    a frame cannot prove.

    The age in a frame ends at the sender. Frames that then wait in the queue of a stuck bus come out later as a burst
    after a silence: the first is refused as INITIAL, the others as TOO_SOON, until the sender's rhythm is back.

    Corruption that goes unnoticed: of frames hit at random 1 in 256, times 3 of 16 counters (`messages.e2e`).
    """

    def __init__(self, *, max_age_s: float = TOPICS["ground"].deadline_s, accept_simulated: bool = False) -> None:
        if not 0.0 < max_age_s < MAX_TOLD_AGE_S:
            raise ValueError(
                f"max_age_s: {max_age_s} is not between 0 and {MAX_TOLD_AGE_S} s, the oldest age a frame tells"
            )
        self.reason: str = Reason.NONE.value
        self._max_age_s = max_age_s
        self._accepted = set(Source) if accept_simulated else {Source.LIVE}
        self._ids = {can_id(message): message for message in (CanMessage.GROUND, CanMessage.GROUND_QUALITY)}
        self._checks = {message: E2eReceiver(profile(message)) for message in self._ids.values()}
        self._min_spacing_ns = round(1e9 * MIN_SPACING_CYCLES * profile(CanMessage.GROUND).cycle_s)
        self._t_ground_ns: int | None = None
        self._first_half: tuple[Fields, int] | None = None

    def feed(self, frame_id: int, data: bytes, t_ns: int) -> ReceivedGround | Refusal:
        """Take one frame received at `t_ns`; return the estimate it completes, or why there is none."""
        message = self._ids.get(frame_id)
        if message is None:
            return Refusal.OTHER_MESSAGE
        last_ns = self._t_ground_ns
        if message is CanMessage.GROUND:
            self._t_ground_ns = t_ns
        check = self._checks[message].check(data, t_ns)
        if check is not E2eCheck.OK:
            return Refusal(check.value)
        fields = decode(message, data)
        if message is CanMessage.GROUND:
            too_soon = last_ns is not None and t_ns - last_ns < self._min_spacing_ns
            self._first_half = None if too_soon else (fields, t_ns)
            return Refusal.TOO_SOON if too_soon else Refusal.FIRST_HALF
        first_half, self._first_half = self._first_half, None
        if first_half is None or first_half[0].numbers["frame_number"] != fields.numbers["frame_number"]:
            return Refusal.FRAME_MISMATCH
        return self._check_pair(first_half[0], fields, first_half[1], t_ns)

    def _check_pair(self, ground: Fields, quality: Fields, t_ground_ns: int, t_ns: int) -> ReceivedGround | Refusal:
        words, numbers = ground.words | quality.words, ground.numbers | quality.numbers
        if words["source"] not in self._accepted:
            return Refusal.NOT_LIVE
        if words["status"] != Status.VALID:
            self.reason = words["reason"]
            return Refusal.NOT_VALID
        age_at_first_s = 1e-3 * numbers["age_ms"]
        age_s = age_at_first_s + 1e-9 * (t_ns - t_ground_ns)
        if not age_s <= self._max_age_s:  # so written, an unknown age (NaN) is refused too
            return Refusal.STALE
        if any(math.isnan(number) for number in numbers.values()):
            return Refusal.NOT_AVAILABLE
        self.reason = words["reason"]
        return ReceivedGround(
            t_exposure_ns=t_ground_ns - round(1e9 * age_at_first_s),
            age_s=age_s,
            source=Source(words["source"]),
            slope_sagittal_rad=numbers["slope_sagittal_rad"],
            slope_frontal_rad=numbers["slope_frontal_rad"],
            height_m=numbers["height_m"],
            slope_sagittal_sd_rad=numbers["slope_sagittal_sd_rad"],
            slope_frontal_sd_rad=numbers["slope_frontal_sd_rad"],
            height_sd_m=numbers["height_sd_m"],
            calibration_id=f"{round(numbers['calibration_id']):03x}",
        )
