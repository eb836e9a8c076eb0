"""The receiving end of a published topic as JSON, whatever carries it: `JsonReceiver`, free of any transport.

What CAN frames have to pass stands in `messages.can_receiver`; the words for what is refused are the same.
"""

import itertools
import math
from typing import Generic, TypeVar

import msgspec

from messages.codec import decode_line
from messages.estimates import (
    Attitude,
    Covariance3,
    Estimate,
    GroundPlane,
    Motion,
    PropagatedGround,
    Source,
    Stamp,
    capture_ns,
)
from messages.reasons import Status
from messages.refusal import Refusal
from messages.terrain import NextFoothold, Terrain
from messages.topics import TOPIC_OF

LONGEST_PAYLOAD_BYTES = 65_536
"""The longest message, a `Health` with every counter, is below 2 kB; what is longer is not parsed."""

NEW_SEQUENCE_SILENCE_S = 1.0
"""A counter that starts again, or another boot, is taken after this much silence: no service restarts faster."""

NEW_SEQUENCE_PERIODS = 3.0
"""And after at least this many periods of the topic: fewer are no silence."""

AGE_TOLERANCE_S = 0.001
"""How far the told age may be from publication minus capture, of which it is made."""

_LARGEST = 2**63

E = TypeVar("E", bound=Estimate)


class Received(msgspec.Struct, Generic[E], frozen=True, kw_only=True):
    """One estimate that passed every check, with its publisher's stamp.

    `age_s` is its age when it was checked. If the publisher's boot is this machine's, the clock is the same and the
    age is exact; otherwise the way here is not in it, only the wait after arrival. `lost_before` counts the numbers
    missing since the message before it: lost, refused or replaced by a newer one. `begins_sequence` marks the first
    message of a service's run: `lost_before` is then 0.
    """

    message: E
    stamp: Stamp
    age_s: float
    lost_before: int
    begins_sequence: bool


class JsonReceiver(Generic[E]):
    """Turns the payloads of one topic of one device, in their order of arrival, into estimates that may be used.

    A payload passes if it is a `kind` with its stamp, well formed and in range; from a live device (or
    `accept_simulated`, which takes replays too); not older than the topic's deadline; and later than the one before
    it: a higher number and a later publication. An estimate that says itself that it is not valid passes: its
    `status` and `reason` tell a consumer to stop acting. One that says it is valid passes only if it is complete.

    A counter that went back, or another boot id, is a new run of the service. It is taken once nothing has passed for
    NEW_SEQUENCE_SILENCE_S and NEW_SEQUENCE_PERIODS, so that two publishers on one key never alternate.

    `boot_id` is that of this machine; `same_machine` says that no other can be at the other end: another boot id is
    then refused at once. Times are CLOCK_MONOTONIC, ns.
    """

    def __init__(
        self,
        kind: type[E],
        device: str,
        *,
        boot_id: str,
        accept_simulated: bool = False,
        same_machine: bool = False,
    ) -> None:
        self._kind: type[E] = kind
        self._topic = TOPIC_OF[kind]
        self._device = device
        self._boot_id = boot_id
        self._same_machine = same_machine
        self._accepted = set(Source) if accept_simulated else {Source.LIVE}
        self._silence_ns = round(1e9 * max(NEW_SEQUENCE_SILENCE_S, NEW_SEQUENCE_PERIODS / self._topic.rate_hz))
        self._last: Stamp | None = None
        self._last_arrival_ns = 0

    def feed(self, payload: bytes, t_arrival_ns: int, t_ns: int) -> Received[E] | Refusal:
        """Take one payload that came at `t_arrival_ns` and is looked at at `t_ns`; return it checked, or why not.

        Never raises for anything that `payload` may hold.
        """
        if len(payload) > LONGEST_PAYLOAD_BYTES:
            return Refusal.MALFORMED
        try:
            topic, message, stamp = decode_line(payload, self._kind)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            return Refusal.MALFORMED
        if topic != self._topic.name or stamp.device != self._device:
            return Refusal.OTHER_TOPIC
        if not _is_in_range(message, stamp):
            return Refusal.MALFORMED
        if stamp.source not in self._accepted:
            return Refusal.NOT_LIVE
        same_clock = stamp.boot_id == self._boot_id
        if self._same_machine and not same_clock:
            return Refusal.OTHER_BOOT
        waited_ns = t_ns - (stamp.t_publish_ns if same_clock else t_arrival_ns)
        if waited_ns < 0:
            return Refusal.WRONG_CLOCK
        age_s = stamp.age_s + 1e-9 * waited_ns
        if age_s > self._topic.deadline_s:
            return Refusal.STALE
        if not _is_complete(message):
            return Refusal.NOT_AVAILABLE
        return self._in_sequence(message, stamp, age_s, t_arrival_ns)

    def _in_sequence(self, message: E, stamp: Stamp, age_s: float, t_arrival_ns: int) -> Received[E] | Refusal:
        last = self._last
        out_of_order = Refusal.OTHER_BOOT
        if last is not None and stamp.boot_id == last.boot_id:
            out_of_order = Refusal.REPEATED if stamp.seq == last.seq else Refusal.WRONG_SEQUENCE
            if stamp.t_publish_ns <= last.t_publish_ns:
                return out_of_order
        follows = last is not None and stamp.boot_id == last.boot_id and stamp.seq > last.seq
        if last is not None and not follows and t_arrival_ns - self._last_arrival_ns < self._silence_ns:
            return out_of_order
        self._last, self._last_arrival_ns = stamp, t_arrival_ns
        return Received(
            message=message,
            stamp=stamp,
            age_s=age_s,
            lost_before=stamp.seq - last.seq - 1 if last is not None and follows else 0,
            begins_sequence=not follows,
        )


def _is_in_range(message: Estimate, stamp: Stamp) -> bool:
    """Return whether times and number fit 63 bits, and the told age is publication minus capture, not before it."""
    t_capture_ns = capture_ns(message)
    if not all(0 <= count < _LARGEST for count in (t_capture_ns, stamp.t_publish_ns, stamp.seq)):
        return False
    age_s = 1e-9 * (stamp.t_publish_ns - t_capture_ns)
    return stamp.age_s >= 0.0 and abs(stamp.age_s - age_s) <= AGE_TOLERANCE_S


def _is_complete(message: Estimate) -> bool:
    """Return whether an estimate that says it is valid has all its numbers, and no negative variance or deviation."""
    if isinstance(message, GroundPlane):
        covariances: tuple[Covariance3, ...] = (message.covariance,)
        numbers: tuple[float, ...] = (
            message.slope_sagittal_rad,
            message.slope_frontal_rad,
            message.height_m,
            message.ahead_m,
            message.left_m,
        )
    elif isinstance(message, PropagatedGround):
        covariances = (message.covariance,)
        numbers = (message.slope_sagittal_rad, message.slope_frontal_rad, message.height_m, message.picture_age_s)
    elif isinstance(message, Attitude):
        covariances = (message.rotation_cov_W_rad2,)
        numbers = (*message.q_WB, *message.w_WB_B_radps, *message.gyro_bias_B_radps)
    elif isinstance(message, Motion):
        alone = (message.distance_var_m2, 0.0, 0.0, 0.0, 0.0, 0.0)
        covariances = (message.velocity_cov_H, message.rate_cov_H, alone)
        numbers = (*message.velocity_H_mps, *message.rate_H_radps, message.distance_m)
    elif isinstance(message, Terrain):
        covariances = tuple((edge.distance_sd_m, 0.0, 0.0, edge.rise_sd_m, 0.0, 0.0) for edge in message.edges)
        told = [(edge.distance_m, edge.rise_m, edge.yaw_rad) for edge in message.edges]
        told += [(thing.distance_m, thing.left_m, thing.height_m) for thing in message.obstacles]
        numbers = (message.probability, *itertools.chain.from_iterable(told))
        foothold = _known_of(message.foothold)
        numbers += foothold
        covariances += tuple((deviation, 0.0, 0.0, 0.0, 0.0, 0.0) for deviation in foothold[1::2])
    else:
        return True
    if message.status is not Status.VALID:
        return True
    is_finite = all(math.isfinite(number) for number in (*numbers, *itertools.chain(*covariances)))
    return is_finite and all(variance >= 0.0 for each in covariances for variance in (each[0], each[3], each[5]))


def _known_of(foothold: NextFoothold) -> tuple[float, ...]:
    """Return the numbers of a foothold that must be there, each with its deviation after it.

    Place and time come together; slopes and height, together, and then the rise, may come with them.
    """
    place, ground, rise = (
        tuple(getattr(foothold, name) for name in names)
        for names in (_FOOTHOLD_PLACE, _FOOTHOLD_GROUND, _FOOTHOLD_RISE)
    )
    needed = 3 if _any_known(rise) else 2 if _any_known(ground) else 1 if _any_known(place) else 0
    return tuple(itertools.chain(*(place, ground, rise)[:needed]))


def _any_known(numbers: tuple[float, ...]) -> bool:
    return not all(math.isnan(number) for number in numbers)


_FOOTHOLD_PLACE = ("ahead_m", "ahead_sd_m", "left_m", "left_sd_m", "time_to_contact_s", "time_to_contact_sd_s")
_FOOTHOLD_GROUND = (
    "slope_sagittal_rad",
    "slope_sagittal_sd_rad",
    "slope_frontal_rad",
    "slope_frontal_sd_rad",
    "height_m",
    "height_sd_m",
)
_FOOTHOLD_RISE = ("rise_m", "rise_sd_m")
