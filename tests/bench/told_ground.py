"""Estimates as the service tells them, of which a test says what it is about."""

from collections.abc import Sequence

from messages import (
    GroundPlane,
    NextFoothold,
    Reason,
    Side,
    Status,
    Terrain,
    TerrainEdge,
    TerrainKind,
)

FRAME_NS = 50_000_000


def told_ground(
    frame: int,
    height_m: float,
    covariance: tuple[float, float, float, float, float, float] = (1e-5, 0.0, 0.0, 1e-5, 0.0, 0.003**2),
    ahead_m: float = 0.7,
) -> GroundPlane:
    """Return valid level ground of a frame."""
    return GroundPlane(
        t_exposure_ns=frame * FRAME_NS,
        frame_seq=frame,
        status=Status.VALID,
        reason=Reason.NONE,
        slope_sagittal_rad=0.0,
        slope_frontal_rad=0.0,
        height_m=height_m,
        covariance=covariance,
        ahead_m=ahead_m,
        matched_share=1.0,
        inlier_share=1.0,
        disparity_noise_px=0.1,
        calibration_id="0",
    )


def told_terrain(kind: TerrainKind, edges: Sequence[TerrainEdge]) -> Terrain:
    """Return valid terrain of these edges, without a foothold."""
    return Terrain(
        t_exposure_ns=1,
        frame_seq=1,
        status=Status.VALID,
        reason=Reason.NONE,
        kind=kind,
        probability=1.0,
        edges=tuple(edges),
        obstacles=(),
        foothold=NextFoothold.unknown(Side.RIGHT),
        calibration_id="0",
    )


def told_edge(distance_m: float, rise_m: float, yaw_rad: float = 0.0) -> TerrainEdge:
    """Return an edge that is known well."""
    return TerrainEdge(
        distance_m=distance_m, distance_sd_m=0.01, rise_m=rise_m, rise_sd_m=0.002, bound_only=False, yaw_rad=yaw_rad
    )
