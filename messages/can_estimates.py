"""What a receiver on CAN gets of each estimate, and how two matching frames are read as one."""

import math
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec

from messages.can_frames import RESERVED, CanMessage, EdgeTold
from messages.estimates import GroundPlane, PropagatedGround, Source
from messages.terrain import Side, Terrain, TerrainKind
from messages.topics import TOPIC_OF, Topic


class CanEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """What all estimates received on CAN have: where they come from, and their age when the second half came.

    Angles are in rad, lengths in m, in the heading frame H. Instants are on the receiver's own clock: reception of the
    first half minus the age it carried.
    """

    source: Source
    age_s: float


class ReceivedGround(CanEstimate, frozen=True, kw_only=True):
    """`messages.GroundPlane` as GROUND and GROUND_QUALITY told it.

    `calibration_id` is the first three of eight hexadecimal digits.
    """

    t_exposure_ns: int
    slope_sagittal_rad: float
    slope_frontal_rad: float
    height_m: float
    slope_sagittal_sd_rad: float
    slope_frontal_sd_rad: float
    height_sd_m: float
    calibration_id: str


class ReceivedPropagatedGround(CanEstimate, frozen=True, kw_only=True):
    """`messages.PropagatedGround` as PROPAGATED_GROUND and PROPAGATED_GROUND_QUALITY told it.

    `picture_age_s` ends at the sample; `age_s`, on top of it, runs from there.
    """

    t_sample_ns: int
    picture_age_s: float
    slope_sagittal_rad: float
    slope_frontal_rad: float
    height_m: float
    slope_sagittal_sd_rad: float
    slope_frontal_sd_rad: float
    height_sd_m: float


class ReceivedFoothold(CanEstimate, frozen=True, kw_only=True):
    """`messages.NextFoothold` as FOOTHOLD and FOOTHOLD_QUALITY told it; slopes and height there are the ground's.

    The rise is NaN where the ground there, or that below the stance foot, is not known.
    """

    t_exposure_ns: int
    side: Side
    ahead_m: float
    ahead_sd_m: float
    left_m: float
    left_sd_m: float
    rise_m: float
    rise_sd_m: float
    time_to_contact_s: float
    time_to_contact_sd_s: float


class ReceivedEdge(msgspec.Struct, frozen=True, kw_only=True):
    """The nearest edge that is not behind; the terms are those of `messages.TerrainEdge`."""

    distance_m: float
    distance_sd_m: float
    rise_m: float
    rise_sd_m: float
    bound_only: bool


class ReceivedTerrain(CanEstimate, frozen=True, kw_only=True):
    """`messages.Terrain` as TERRAIN and TERRAIN_QUALITY told it: what is nearest of all that is not behind.

    Of `edges_ahead` and `obstacles_ahead` 7 means 7 or more. `obstacle_distance_m` and `obstacle_left_m` are NaN
    without an obstacle.
    """

    t_exposure_ns: int
    kind: TerrainKind
    probability: float
    edge: ReceivedEdge | None
    edges_ahead: int
    obstacle_distance_m: float
    obstacle_left_m: float
    obstacles_ahead: int


R = TypeVar("R", bound=CanEstimate)


class Told(NamedTuple):
    """Both halves, decoded: `t_ns` is the instant for which they stand, on the receiver's clock."""

    t_ns: int
    age_s: float
    source: Source
    words: dict[str, str]
    numbers: dict[str, float]

    @property
    def lacks(self) -> list[str]:
        """Return the names of the numbers that are missing."""
        return [name for name, number in self.numbers.items() if math.isnan(number)]

    def converted(self, estimate: type[R], /, **changed: object) -> R:
        """Return the estimate whose fields are named as signals are, but for those `changed`."""
        fields = {**self.numbers, **self.words, "source": self.source, "age_s": self.age_s, **changed}
        return msgspec.convert(fields, estimate)


class PairOfFrames(NamedTuple, Generic[R]):
    """The two frames of one kind of estimate, its topic, and how they are read: None where a number is missing."""

    first: CanMessage
    second: CanMessage
    topic: Topic
    read: Callable[[Told], R | None]


def _ground(told: Told) -> ReceivedGround | None:
    if told.lacks:
        return None
    calibration_id = f"{round(told.numbers['calibration_id']):03x}"
    return told.converted(ReceivedGround, t_exposure_ns=told.t_ns, calibration_id=calibration_id)


def _propagated_ground(told: Told) -> ReceivedPropagatedGround | None:
    if told.lacks:
        return None
    picture_age_s = 1e-3 * told.numbers["picture_age_ms"]
    return told.converted(ReceivedPropagatedGround, t_sample_ns=told.t_ns, picture_age_s=picture_age_s)


def _foothold(told: Told) -> ReceivedFoothold | None:
    if {*told.lacks} not in (set(), {"rise_m", "rise_sd_m"}) or told.words["side"] == RESERVED:
        return None
    return told.converted(ReceivedFoothold, t_exposure_ns=told.t_ns)


def _terrain(told: Told) -> ReceivedTerrain | None:
    numbers, kind, edge = told.numbers, told.words["kind"], told.words["edge"]
    may_lack: tuple[str, ...] = ("edge_",) if edge == EdgeTold.NONE else ()
    may_lack += () if numbers["obstacles_ahead"] else ("obstacle_",)
    if edge == RESERVED or not all(name.startswith(may_lack) for name in told.lacks):
        return None
    return told.converted(
        ReceivedTerrain,
        t_exposure_ns=told.t_ns,
        kind=TerrainKind.UNKNOWN if kind == RESERVED else kind,
        edge=None if edge == EdgeTold.NONE else _edge(numbers, bound_only=edge == EdgeTold.BOUND_ONLY),
        edges_ahead=round(numbers["edges_ahead"]),
        obstacles_ahead=round(numbers["obstacles_ahead"]),
    )


def _edge(numbers: dict[str, float], *, bound_only: bool) -> ReceivedEdge:
    return ReceivedEdge(
        distance_m=numbers["edge_distance_m"],
        distance_sd_m=numbers["edge_distance_sd_m"],
        rise_m=numbers["edge_rise_m"],
        rise_sd_m=numbers["edge_rise_sd_m"],
        bound_only=bound_only,
    )


PAIRS: dict[type[CanEstimate], PairOfFrames[Any]] = {
    ReceivedGround: PairOfFrames(CanMessage.GROUND, CanMessage.GROUND_QUALITY, TOPIC_OF[GroundPlane], _ground),
    ReceivedPropagatedGround: PairOfFrames(
        CanMessage.PROPAGATED_GROUND,
        CanMessage.PROPAGATED_GROUND_QUALITY,
        TOPIC_OF[PropagatedGround],
        _propagated_ground,
    ),
    ReceivedFoothold: PairOfFrames(CanMessage.FOOTHOLD, CanMessage.FOOTHOLD_QUALITY, TOPIC_OF[Terrain], _foothold),
    ReceivedTerrain: PairOfFrames(CanMessage.TERRAIN, CanMessage.TERRAIN_QUALITY, TOPIC_OF[Terrain], _terrain),
}
"""Every kind of estimate that goes on CAN."""
