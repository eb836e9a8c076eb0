"""The receiving end of set-points on CAN: `SetpointReceiver`, of SETPOINT and SETPOINT_QUALITY or of SETPOINT_FD."""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from messages.can_checks import FrameChecks
from messages.can_estimates import CanEstimate
from messages.can_frames import POINT_NUMBERS, RESERVED, CanMessage, Fields, decode, on_point
from messages.estimates import Source
from messages.inputs import GaitPhase
from messages.reasons import Reason, Status
from messages.refusal import Refusal
from messages.setpoint import STANCE_PERCENT, Points, Setpoint
from messages.topics import TOPIC_OF


class ReceivedSetpoint(CanEstimate, frozen=True, kw_only=True):
    """`messages.Setpoint` as frames told it; `age_s` is that of its oldest point.

    The deviation of the equilibrium, and those of stiffness and damping as shares of their values, are the largest
    over stance.
    """

    t_exposure_ns: int
    phase: GaitPhase
    slope_rad: float
    slope_sd_rad: float
    equilibrium_rad: Points
    stiffness_nm_per_rad: Points
    damping_nms_per_rad: Points
    equilibrium_sd_rad: float
    stiffness_sd_share: float
    damping_sd_share: float


class _Point(NamedTuple):
    """One point: when its ground was seen, on the receiver's clock, and its numbers."""

    t_exposure_ns: int
    source: Source
    equilibrium_rad: float
    stiffness_nm_per_rad: float
    damping_nms_per_rad: float


class SetpointReceiver:
    """Turns the frames of a bus, in their order of arrival, into set-points that may be acted upon.

    An update is five points and SETPOINT_QUALITY, which gives the set-point. Each point must pass its protection, come
    from a live device (or `accept_simulated`), be valid and complete; where one is lost, that of an update before
    stands in for it while it is not older than `max_age_s`, without which the deadline of the topic holds. An update
    that is not valid makes an end of all points before it: `reason` is its word. SETPOINT_FD is all of that at once.
    Raises ValueError for a `max_age_s` that a frame cannot prove.

    Frames that waited in the queue of a stuck bus come as a burst after a silence: the first of each message is refused
    as INITIAL and takes all points with it, others as TOO_SOON.
    """

    def __init__(self, *, max_age_s: float | None = None, accept_simulated: bool = False) -> None:
        self._checks = FrameChecks(_MESSAGES, TOPIC_OF[Setpoint], max_age_s, accept_simulated=accept_simulated)
        self.reason: str = Reason.NONE.value
        self._points: dict[float, _Point] = {}

    @property
    def can_ids(self) -> tuple[int, ...]:
        """Return the identifiers of the frames that are read."""
        return tuple(self._checks.messages)

    def feed(self, frame_id: int, data: bytes, t_ns: int) -> ReceivedSetpoint | Refusal:
        """Take one frame received at `t_ns`; return the set-point it completes, or why there is none."""
        message = self._checks.messages.get(frame_id)
        if message is None:
            return Refusal.OTHER_MESSAGE
        refusal = self._checks.refusal(message, data, t_ns)
        if refusal is Refusal.INITIAL:
            self._points.clear()
        if refusal is not None:
            return refusal
        fields = decode(message, data)
        percent = fields.numbers.get("stance_percent", 0.0)
        if self._checks.too_soon((message, percent), t_ns):
            return Refusal.TOO_SOON
        if message is CanMessage.SETPOINT:
            return self._take(fields, {percent: POINT_NUMBERS}, t_ns)
        if message is CanMessage.SETPOINT_FD:
            refusal = self._take(fields, _OF_FD, t_ns)
            if refusal is not Refusal.FIRST_HALF:
                self.reason = fields.words["reason"]
                return refusal
        return self._complete(fields, t_ns)

    def _take(self, fields: Fields, points: Mapping[float, tuple[str, ...]], t_ns: int) -> Refusal:
        """Keep the points of a frame, each with the names of its numbers."""
        words, told = fields.words, fields.numbers
        if words["source"] not in self._checks.accepted or words["status"] != Status.VALID:
            self._points.clear()
            return Refusal.NOT_LIVE if words["source"] not in self._checks.accepted else Refusal.NOT_VALID
        if math.isnan(told["age_ms"]) or told["age_ms"] > 1e3 * self._checks.max_age_s:
            return Refusal.STALE
        t_exposure_ns = t_ns - round(1e6 * told["age_ms"])
        for percent, names in points.items():
            numbers = [told[name] for name in names]
            if percent not in STANCE_PERCENT or any(map(math.isnan, numbers)):
                self._points.pop(percent, None)
                return Refusal.NOT_AVAILABLE
            self._points[percent] = _Point(t_exposure_ns, Source(words["source"]), *numbers)
        return Refusal.FIRST_HALF

    def _complete(self, quality: Fields, t_ns: int) -> ReceivedSetpoint | Refusal:
        self.reason = quality.words["reason"]
        if self.reason != Reason.NONE:
            self._points.clear()
            return Refusal.NOT_VALID
        told, phase = quality.numbers, quality.words["phase"]
        if len(self._points) < len(STANCE_PERCENT) or phase == RESERVED or any(map(math.isnan, told.values())):
            return Refusal.NOT_AVAILABLE
        points = [self._points[percent] for percent in STANCE_PERCENT]
        oldest = min(points, key=lambda point: point.t_exposure_ns)
        age_s = 1e-9 * (t_ns - oldest.t_exposure_ns)
        if age_s > self._checks.max_age_s:
            return Refusal.STALE
        return ReceivedSetpoint(
            source=oldest.source,
            age_s=age_s,
            t_exposure_ns=oldest.t_exposure_ns,
            phase=GaitPhase(phase),
            slope_rad=told["slope_rad"],
            slope_sd_rad=told["slope_sd_rad"],
            equilibrium_rad=_five(point.equilibrium_rad for point in points),
            stiffness_nm_per_rad=_five(point.stiffness_nm_per_rad for point in points),
            damping_nms_per_rad=_five(point.damping_nms_per_rad for point in points),
            equilibrium_sd_rad=told["equilibrium_sd_rad"],
            stiffness_sd_share=told["stiffness_sd_share"],
            damping_sd_share=told["damping_sd_share"],
        )


def _five(numbers: Iterable[float]) -> Points:
    a, b, c, d, e = numbers
    return a, b, c, d, e


_MESSAGES = (CanMessage.SETPOINT, CanMessage.SETPOINT_QUALITY, CanMessage.SETPOINT_FD)
_OF_FD: dict[float, tuple[str, ...]] = {
    percent: tuple(on_point(name, percent) for name in POINT_NUMBERS) for percent in STANCE_PERCENT
}
