"""The ground ahead as surfaces and edges: what the pipeline publishes on the topic `terrain`."""

import enum

import msgspec

from messages.reasons import Reason, Status, status_without_numbers


class TerrainKind(str, enum.Enum):
    """What most of the path from 0.3 to 1.0 m ahead is. Within 0.35 m of an edge it is a step's, or a flight's."""

    LEVEL = "level"
    RAMP_UP = "ramp_up"
    RAMP_DOWN = "ramp_down"
    STAIRS_UP = "stairs_up"
    STAIRS_DOWN = "stairs_down"
    STEP_UP = "step_up"
    STEP_DOWN = "step_down"
    ROUGH = "rough"
    UNKNOWN = "unknown"


class TerrainEdge(msgspec.Struct, frozen=True, kw_only=True):
    """An edge across the path.

    `distance_m` along x of H from the point on the ground below the left optical centre to the border of the upper
    surface, negative behind; `rise_m` > 0 up. `bound_only`: the ground falls by `rise_m` or more, how much is still
    hidden behind the lip. `yaw_rad` turns x of H to the edge's normal, > 0 to the left.
    """

    distance_m: float
    distance_sd_m: float
    rise_m: float
    rise_sd_m: float
    bound_only: bool
    yaw_rad: float


class TerrainObstacle(msgspec.Struct, frozen=True, kw_only=True):
    """A thing on the path that is no ground.

    `distance_m` along x of H from the point on the ground below the left optical centre to its nearest part, `left_m`
    that part's y in H (> 0 left); `height_m` is how far it rises above the ground that it stands on.
    """

    distance_m: float
    left_m: float
    height_m: float


class Side(str, enum.Enum):
    """Which foot."""

    LEFT = "left"
    RIGHT = "right"


class NextFoothold(msgspec.Struct, frozen=True, kw_only=True):
    """Where and when the foot of the prosthetic `side` lands next, and the ground there, in H.

    `ahead_m` and `left_m` are x and y of the middle of the foot in H; slopes and `height_m` mean what they do in
    `GroundPlane`; `rise_m` is the ground there relative to that below the stance foot, > 0 up; `time_to_contact_s`
    runs from the exposure. Every number has its deviation. Where the next step is not known every number is NaN; where
    the ground there is not known, slopes, height and rise are; where that below the stance foot is not, the rise is.
    """

    side: Side
    ahead_m: float
    ahead_sd_m: float
    left_m: float
    left_sd_m: float
    slope_sagittal_rad: float
    slope_sagittal_sd_rad: float
    slope_frontal_rad: float
    slope_frontal_sd_rad: float
    height_m: float
    height_sd_m: float
    rise_m: float
    rise_sd_m: float
    time_to_contact_s: float
    time_to_contact_sd_s: float

    @classmethod
    def unknown(cls, side: Side) -> "NextFoothold":
        """Return the foothold of which only the `side` is known."""
        return cls(
            side=side,
            ahead_m=_NAN,
            ahead_sd_m=_NAN,
            left_m=_NAN,
            left_sd_m=_NAN,
            slope_sagittal_rad=_NAN,
            slope_sagittal_sd_rad=_NAN,
            slope_frontal_rad=_NAN,
            slope_frontal_sd_rad=_NAN,
            height_m=_NAN,
            height_sd_m=_NAN,
            rise_m=_NAN,
            rise_sd_m=_NAN,
            time_to_contact_s=_NAN,
            time_to_contact_sd_s=_NAN,
        )


class Terrain(msgspec.Struct, frozen=True, kw_only=True):
    """The ground on the path ahead, in the heading frame H of the frame exposed at `t_exposure_ns`.

    The path is half a metre wide along x of H. `probability` is that of `kind`; `edges` are in the order of their
    distance, those confirmed by several frames, from 0.3 m behind on; `obstacles` in the order of theirs.
    """

    t_exposure_ns: int
    frame_seq: int
    status: Status
    reason: Reason
    kind: TerrainKind
    probability: float
    edges: tuple[TerrainEdge, ...]
    obstacles: tuple[TerrainObstacle, ...]
    foothold: NextFoothold
    calibration_id: str

    @classmethod
    def invalid(
        cls, *, t_exposure_ns: int, frame_seq: int, reason: Reason, side: Side, calibration_id: str
    ) -> "Terrain":
        """Return the estimate that says only why there is none: kind unknown, no probability, nothing on the path.

        Raises ValueError for `Reason.NONE`.
        """
        return cls(
            t_exposure_ns=t_exposure_ns,
            frame_seq=frame_seq,
            status=status_without_numbers(reason),
            reason=reason,
            kind=TerrainKind.UNKNOWN,
            probability=_NAN,
            edges=(),
            obstacles=(),
            foothold=NextFoothold.unknown(side),
            calibration_id=calibration_id,
        )

    def without_numbers(self, reason: Reason) -> "Terrain":
        """Return what is left of the estimate for a `reason` that is not NONE."""
        return Terrain.invalid(
            t_exposure_ns=self.t_exposure_ns,
            frame_seq=self.frame_seq,
            reason=reason,
            side=self.foothold.side,
            calibration_id=self.calibration_id,
        )


_NAN = float("nan")
