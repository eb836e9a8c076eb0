"""Estimates as CAN frames, two frames an estimate, a set-point six or one of CAN FD: `CanEncoder`.

A number that does not fit its signal is not clipped: the estimate then leaves as INVALID, reason OUT_OF_RANGE, with no
numbers at all. Standard deviations and ages are rounded up and probabilities down, so that a frame never claims more
than the estimate did.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import NamedTuple, TypeVar

from messages.can_frames import (
    POINT_NUMBERS,
    CanFrame,
    CanMessage,
    Code,
    EdgeTold,
    can_id,
    codes,
    down,
    on_point,
    packed,
    profile,
    up,
)
from messages.e2e import E2eSender
from messages.estimates import GroundPlane, Health, PropagatedGround, Stamp
from messages.inputs import AnkleState
from messages.reasons import Reason, Status
from messages.setpoint import STANCE_PERCENT, Setpoint
from messages.terrain import Terrain

FRAME_NUMBERS = 16
COUNT_MODULUS = 4096
MOST_COUNTED = 7
"""So many edges or obstacles, or more."""

E = TypeVar("E", GroundPlane, PropagatedGround, Terrain, Setpoint)


class _Content(NamedTuple):
    """What two frames say. A number that is None is rightly missing; one that is NaN or does not fit is not."""

    status: Status
    reason: Reason
    numbers: Mapping[str, float | None]
    words: Mapping[str, Enum]
    counts: Mapping[str, int]


class CanEncoder:
    """Makes the frames of every message, each protected and numbered in the order of the calls.

    The two frames of an estimate are to be sent in the order given. `age_s` runs from the instant for which the
    estimate stands to now.
    """

    def __init__(self) -> None:
        self._senders = {message: E2eSender(profile(message)) for message in CanMessage}

    def ground(self, ground: GroundPlane, stamp: Stamp, age_s: float) -> tuple[CanFrame, CanFrame]:
        """Return GROUND and GROUND_QUALITY. Raises ValueError if `calibration_id` is no hexadecimal number."""
        return self._pair((CanMessage.GROUND, CanMessage.GROUND_QUALITY), ground, _ground_content, stamp, age_s)

    def propagated_ground(self, ground: PropagatedGround, stamp: Stamp, age_s: float) -> tuple[CanFrame, CanFrame]:
        """Return PROPAGATED_GROUND and PROPAGATED_GROUND_QUALITY."""
        pair = (CanMessage.PROPAGATED_GROUND, CanMessage.PROPAGATED_GROUND_QUALITY)
        return self._pair(pair, ground, _propagated_content, stamp, age_s)

    def foothold(self, terrain: Terrain, stamp: Stamp, age_s: float) -> tuple[CanFrame, CanFrame]:
        """Return FOOTHOLD and FOOTHOLD_QUALITY; while the next step is not known they have no number but the age."""
        return self._pair((CanMessage.FOOTHOLD, CanMessage.FOOTHOLD_QUALITY), terrain, _foothold_content, stamp, age_s)

    def terrain(self, terrain: Terrain, stamp: Stamp, age_s: float) -> tuple[CanFrame, CanFrame]:
        """Return TERRAIN and TERRAIN_QUALITY: the kind of ground, and the nearest edge and obstacle not behind."""
        return self._pair((CanMessage.TERRAIN, CanMessage.TERRAIN_QUALITY), terrain, _terrain_content, stamp, age_s)

    def setpoint(self, setpoint: Setpoint, stamp: Stamp, age_s: float) -> tuple[CanFrame, ...]:
        """Return five frames SETPOINT, one a point, and SETPOINT_QUALITY."""
        raws = self._raws(codes(CanMessage.SETPOINT_FD), setpoint, _setpoint_content, stamp, age_s)
        points = (
            self._frame(
                CanMessage.SETPOINT,
                {name: raws[name] for name in ("frame_number", "status", "source", "age_ms")}
                | {"stance_percent": place}
                | {name: raws[on_point(name, percent)] for name in POINT_NUMBERS},
            )
            for place, percent in enumerate(STANCE_PERCENT)
        )
        return *points, self._frame(CanMessage.SETPOINT_QUALITY, _of(CanMessage.SETPOINT_QUALITY, raws))

    def setpoint_fd(self, setpoint: Setpoint, stamp: Stamp, age_s: float) -> CanFrame:
        """Return SETPOINT_FD, for a bus of CAN FD."""
        raws = self._raws(codes(CanMessage.SETPOINT_FD), setpoint, _setpoint_content, stamp, age_s)
        return self._frame(CanMessage.SETPOINT_FD, _of(CanMessage.SETPOINT_FD, raws))

    def health(self, health: Health, stamp: Stamp) -> CanFrame:
        """Return HEALTH: counts since the start, modulo 4096."""
        counts = {
            "imu_lost": health.imu_lost,
            "imu_bus_errors": health.imu_bus_errors,
            "frames_dropped": sum(health.frames_dropped.values()),
            "frames_refused": sum(health.refused.values()),
        }
        words = _raw_words(codes(CanMessage.HEALTH), {"source": stamp.source, "load": health.load})
        return self._frame(CanMessage.HEALTH, {name: count % COUNT_MODULUS for name, count in counts.items()} | words)

    def ankle(self, state: AnkleState) -> CanFrame:
        """Return ANKLE_STATE as the controller of an ankle sends it; a number that does not fit is not available."""
        layout = codes(CanMessage.ANKLE_STATE)
        numbers = {name: layout[name].raw(getattr(state, name)) for name in _ANKLE_NUMBERS}
        return self._frame(CanMessage.ANKLE_STATE, numbers | _raw_words(layout, {"phase": state.phase}))

    def _pair(
        self,
        pair: tuple[CanMessage, CanMessage],
        estimate: E,
        content_of: Callable[[E], _Content],
        stamp: Stamp,
        age_s: float,
    ) -> tuple[CanFrame, CanFrame]:
        """Return both halves, each value in the one that has a signal of its name."""
        raws = self._raws(_layout(*pair), estimate, content_of, stamp, age_s)
        first, second = (self._frame(message, _of(message, raws)) for message in pair)
        return first, second

    def _raws(
        self,
        layout: Mapping[str, Code],
        estimate: E,
        content_of: Callable[[E], _Content],
        stamp: Stamp,
        age_s: float,
    ) -> dict[str, int | None]:
        content = content_of(estimate)
        raws = _raw_numbers(layout, content)
        unfit = any(raws[name] is None for name, value in content.numbers.items() if value is not None)
        if unfit and content.status is Status.VALID:
            content = content_of(estimate.without_numbers(Reason.OUT_OF_RANGE))
            raws = _raw_numbers(layout, content)
        words: dict[str, Enum] = {
            "status": content.status,
            "source": stamp.source,
            "reason": content.reason,
            **content.words,
        }
        raws |= {**content.counts, **_raw_words(layout, words)}
        return raws | {"frame_number": stamp.seq % FRAME_NUMBERS, "age_ms": _age_ms(layout["age_ms"], age_s)}

    def _frame(self, message: CanMessage, raws: Mapping[str, int | None]) -> CanFrame:
        layout = codes(message)
        present = {
            name: value
            for name, raw in raws.items()
            if (value := layout[name].not_available if raw is None else raw) is not None
        }
        return CanFrame(can_id(message), self._senders[message].protect(packed(message, present)))


def _of(message: CanMessage, raws: Mapping[str, int | None]) -> dict[str, int | None]:
    return {name: raws[name] for name in codes(message) if name in raws}


@functools.cache
def _layout(first: CanMessage, second: CanMessage) -> dict[str, Code]:
    return codes(first) | codes(second)


def _ground_content(ground: GroundPlane) -> _Content:
    counts = {"calibration_id": int(ground.calibration_id[:3], 16)}
    return _Content(ground.status, ground.reason, _plane_numbers(ground), {}, counts)


def _propagated_content(ground: PropagatedGround) -> _Content:
    numbers = _plane_numbers(ground) | {"picture_age_ms": 1e3 * ground.picture_age_s}
    return _Content(ground.status, ground.reason, numbers, {}, {})


def _plane_numbers(plane: GroundPlane | PropagatedGround) -> dict[str, float | None]:
    variances = (plane.covariance[i] for i in (0, 3, 5))
    deviations = [math.sqrt(variance) if variance >= 0.0 else math.nan for variance in variances]
    return {
        "slope_sagittal_rad": plane.slope_sagittal_rad,
        "slope_frontal_rad": plane.slope_frontal_rad,
        "height_m": plane.height_m,
        "slope_sagittal_sd_rad": deviations[0],
        "slope_frontal_sd_rad": deviations[1],
        "height_sd_m": deviations[2],
    }


def _foothold_content(terrain: Terrain) -> _Content:
    found = terrain.foothold
    numbers: dict[str, float | None] = {name: getattr(found, name) for name in _FOOTHOLD_NUMBERS}
    for unknown in (_FOOTHOLD_NUMBERS, _RISE_NUMBERS):
        if all(math.isnan(getattr(found, name)) for name in unknown):
            numbers |= dict.fromkeys(unknown)
    return _Content(terrain.status, terrain.reason, numbers, {"side": found.side}, {})


def _terrain_content(terrain: Terrain) -> _Content:
    edges = [edge for edge in terrain.edges if edge.distance_m >= 0.0]
    obstacles = [thing for thing in terrain.obstacles if thing.distance_m >= 0.0]
    numbers: dict[str, float | None] = dict.fromkeys(_TERRAIN_NUMBERS)
    numbers["probability"] = terrain.probability
    told = EdgeTold.NONE
    if edges:
        told = EdgeTold.BOUND_ONLY if edges[0].bound_only else EdgeTold.MEASURED
        numbers |= {f"edge_{name}": getattr(edges[0], name) for name in _EDGE_NUMBERS}
    if obstacles:
        numbers |= {f"obstacle_{name}": getattr(obstacles[0], name) for name in _OBSTACLE_NUMBERS}
    counts = {"edges_ahead": min(len(edges), MOST_COUNTED), "obstacles_ahead": min(len(obstacles), MOST_COUNTED)}
    return _Content(terrain.status, terrain.reason, numbers, {"kind": terrain.kind, "edge": told}, counts)


def _setpoint_content(setpoint: Setpoint) -> _Content:
    numbers: dict[str, float | None] = {
        on_point(name, percent): value
        for name in POINT_NUMBERS
        for percent, value in zip(STANCE_PERCENT, getattr(setpoint, name), strict=True)
    }
    numbers |= {
        "slope_rad": setpoint.slope_rad,
        "slope_sd_rad": setpoint.slope_sd_rad,
        "equilibrium_sd_rad": _largest(setpoint.equilibrium_sd_rad),
        "stiffness_sd_share": _largest_share(setpoint.stiffness_sd_nm_per_rad, setpoint.stiffness_nm_per_rad),
        "damping_sd_share": _largest_share(setpoint.damping_sd_nms_per_rad, setpoint.damping_nms_per_rad),
    }
    return _Content(setpoint.status, setpoint.reason, numbers, {"phase": setpoint.phase}, {})


def _largest(values: Sequence[float]) -> float:
    """Return the largest; NaN where one is."""
    return math.nan if any(map(math.isnan, values)) else max(values)


def _largest_share(deviations: Sequence[float], values: Sequence[float]) -> float:
    return _largest([sd / of if of > 0.0 else math.nan for sd, of in zip(deviations, values, strict=True)])


def _raw_numbers(layout: Mapping[str, Code], content: _Content) -> dict[str, int | None]:
    return {
        name: None if value is None else layout[name].raw(value, _rounding(name))
        for name, value in content.numbers.items()
    }


def _rounding(name: str) -> Callable[[float], int]:
    if name == "probability":
        return down
    return up if "_sd_" in name or name == "picture_age_ms" else round


def _raw_words(layout: Mapping[str, Code], words: Mapping[str, Enum]) -> dict[str, int]:
    return {name: layout[name].raw_of_word(word) for name, word in words.items()}


def _age_ms(code: Code, age_s: float) -> int | None:
    """An age saturates at the signal's end, which means 'this old or older'; an impossible one is not available."""
    return code.raw(min(1e3 * age_s, code.raw_max * code.scale), up)


_ANKLE_NUMBERS = ("ankle_angle_rad", "ankle_rate_radps", "load_n")
_FOOTHOLD_NUMBERS = tuple(
    f"{name}{deviation}{unit}"
    for name, unit in (("ahead", "_m"), ("left", "_m"), ("time_to_contact", "_s"), ("rise", "_m"))
    for deviation in ("", "_sd")
)
_RISE_NUMBERS = ("rise_m", "rise_sd_m")
_EDGE_NUMBERS = ("distance_m", "distance_sd_m", "rise_m", "rise_sd_m")
_OBSTACLE_NUMBERS = ("distance_m", "left_m")
_TERRAIN_NUMBERS = tuple(f"edge_{name}" for name in _EDGE_NUMBERS) + tuple(
    f"obstacle_{name}" for name in _OBSTACLE_NUMBERS
)
