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


class Terrain(msgspec.Struct, frozen=True, kw_only=True):
    """The ground on the path ahead, in the heading frame H of the frame exposed at `t_exposure_ns`.

    The path is half a metre wide along x of H. `probability` is that of `kind`; `edges` are in the order of their
    distance, those confirmed by several frames, from 0.3 m behind on.
    """

    t_exposure_ns: int
    frame_seq: int
    status: Status
    reason: Reason
    kind: TerrainKind
    probability: float
    edges: tuple[TerrainEdge, ...]
    calibration_id: str

    @classmethod
    def invalid(cls, *, t_exposure_ns: int, frame_seq: int, reason: Reason, calibration_id: str) -> "Terrain":
        """Return the estimate that says only why there is none: kind unknown, no edges, no probability.

        Raises ValueError for `Reason.NONE`.
        """
        return cls(
            t_exposure_ns=t_exposure_ns,
            frame_seq=frame_seq,
            status=status_without_numbers(reason),
            reason=reason,
            kind=TerrainKind.UNKNOWN,
            probability=float("nan"),
            edges=(),
            calibration_id=calibration_id,
        )
