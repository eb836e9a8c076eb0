"""A level floor as truth: pictures of one with the camera's pose from motion capture (z up, floor at z = 0)."""

from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from drivers.recording.asl_folder import TruthTrack
from messages import Frame, GroundPlane, Status, UnitCalibration
from messages.arrays import FloatArray, rms
from perception import so3
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings


def pose_at(track: TruthTrack, t_ns: int) -> tuple[FloatArray, FloatArray] | None:
    """Return R_WB (3, 3) and p_WB (3,) at `t_ns`, interpolated; None outside the track."""
    after = int(np.searchsorted(track.t_ns, t_ns))
    if after == len(track.t_ns) or (after == 0 and track.t_ns[0] != t_ns):
        return None
    before = max(0, after - 1)
    span = int(track.t_ns[after] - track.t_ns[before])
    share = (t_ns - int(track.t_ns[before])) / span if span else 0.0
    q_before, q_after = (so3.normalised(tuple(track.q_WB[k].tolist())) for k in (before, after))
    R_WB = so3.matrix_from_quaternion(so3.slerp(q_before, q_after, share))
    return R_WB, (1 - share) * track.p_WB_m[before] + share * track.p_WB_m[after]


class FloorScore(msgspec.Struct, frozen=True, kw_only=True):
    """A floor that is level: its slopes are errors. RMS over the valid frames; NaN where there are none."""

    frames: int
    slope_sagittal_rms_deg: float
    slope_frontal_rms_deg: float
    angle_rms_deg: float
    height_mean_m: float
    height_error_mean_mm: float
    height_error_rms_mm: float


def score_floor(
    frames: Iterable[Frame],
    grounds: Sequence[GroundPlane],
    track: TruthTrack,
    calibration: UnitCalibration,
    foothold: FootholdSettings,
) -> dict[str, FloorScore]:
    """Return the scores of `grounds` (attitude from the IMU) and of the same frames with the true attitude."""
    estimator = GroundEstimator(calibration, foothold)
    by_time = {ground.t_exposure_ns: ground for ground in grounds}
    imu: list[tuple[GroundPlane, float]] = []
    true: list[tuple[GroundPlane, float]] = []
    for frame in frames:
        pose = pose_at(track, frame.header.t_exposure_ns)
        if pose is None:
            continue
        R_WB, p_WB = pose
        height_m = float((p_WB + R_WB @ np.array(calibration.X_BE.p_m))[2])
        true.append((estimator.estimate(frame, R_WB, (0.0, 0.0, 0.0), np.zeros((3, 3))), height_m))
        ground = by_time.get(frame.header.t_exposure_ns)
        if ground is not None:
            imu.append((ground, height_m))
    return {"IMU's attitude": _score(imu), "true attitude": _score(true)}


def _score(pairs: list[tuple[GroundPlane, float]]) -> FloorScore:
    rows = np.array(
        [
            (ground.slope_sagittal_rad, ground.slope_frontal_rad, ground.height_m, height_m)
            for ground, height_m in pairs
            if ground.status is Status.VALID
        ]
    ).reshape(-1, 4)
    if len(rows) == 0:
        rows = np.full((1, 4), np.nan)
    sagittal, frontal, height_m, true_m = rows.T
    error_mm = 1e3 * (height_m - true_m)
    angle = np.arctan(np.hypot(np.tan(sagittal), np.tan(frontal)))
    return FloorScore(
        frames=int(np.isfinite(sagittal).sum()),
        slope_sagittal_rms_deg=rms(np.degrees(sagittal)),
        slope_frontal_rms_deg=rms(np.degrees(frontal)),
        angle_rms_deg=rms(np.degrees(angle)),
        height_mean_m=float(height_m.mean()),
        height_error_mean_mm=float(error_mm.mean()),
        height_error_rms_mm=rms(error_mm),
    )
