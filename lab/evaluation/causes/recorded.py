"""Errors split by cause on a recording with truth: of the rig, or in the ASL layout over a level floor at z = 0.

The true attitude and the true plane take the place of the measured ones, as on the rig. No recording has the true
bias, mounting or time of exposure; taken away is what explains the recording's errors best:

- IMU bias: what of the attitude's error stays the same in the IMU's axes;
- extrinsic: what stays the same, ahead and across, with the true attitude; a lasting depth error is in it;
- synchronisation: what of the errors follows the rate at which the IMU turns the slopes, by least squares.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from daemon.replay_source import ReplaySource, open_source
from lab.evaluation.causes.ledger import AS_MEASURED, Ledger, SlopeError
from lab.evaluation.causes.names import DEPTH, EXTRINSIC, IMU, ORIENTATION, SYNCHRONISATION
from lab.evaluation.causes.seen_plane import error_of, error_of_attitude
from lab.evaluation.causes.told import ToldAttitudes
from lab.evaluation.floor import pose_at
from messages import Attitude, Frame, GroundPlane, GroundTruth, Status
from messages.arrays import FloatArray, rms
from messages.errors import UserError
from perception import so3
from perception.attitude.history import AttitudeAt
from perception.ground.estimator import GroundEstimator
from perception.heading import heading

REPLACED = {
    IMU: "less what stays in its axes",
    ORIENTATION: "the true attitude",
    DEPTH: "the true plane",
    EXTRINSIC: "less what stays in the camera's",
    SYNCHRONISATION: "less what follows the rate",
}
_LEAST_FRAMES = 5
_LEAST_RATE_RADPS = math.radians(3.0)
"""A camera that turns more slowly, RMS, tells nothing of the time of its frames."""


class Explained(msgspec.Struct, frozen=True, kw_only=True):
    """What explains a recording best: `imu_bias_deg` (3,), a rotation in B; `extrinsic_deg` (2,), ahead and across;
    `late_s`, the time by which the frames' stamps are too late. NaN where the recording does not tell."""

    imu_bias_deg: tuple[float, float, float]
    extrinsic_deg: tuple[float, float]
    late_s: float


@dataclass(frozen=True)
class _Row:
    """One frame: the error as measured, the attitude as told, if it was told by then, and the truth."""

    measured: SlopeError
    told: AttitudeAt | None
    true_R_WB: FloatArray
    truth: GroundTruth


def split(path: Path) -> tuple[Ledger, Explained]:
    """Return the errors of the recording at `path` by cause.

    Raises UserError where it cannot be opened, has no truth, or fewer than 5 valid frames that have one.
    """
    source = open_source(path, None)
    R_BE = np.array(source.calibration.X_BE.R)
    rows, with_true_attitude = _replayed(source)
    if min(len(rows), len(with_true_attitude)) < _LEAST_FRAMES:
        raise UserError(f"{path}: {len(rows)} frames are valid and have a truth, allowed {_LEAST_FRAMES} or more")
    told = {t_ns: _Told(row, row.told, R_BE) for t_ns, row in rows.items() if row.told is not None}
    bias_B = np.mean([each.tilt_B for each in told.values()], axis=0) if told else np.full(3, np.nan)
    late_s = _late_s(list(told.values()))
    extrinsic = np.mean([each.slopes for each in with_true_attitude.values()], axis=0)
    ledger = Ledger(REPLACED)
    for t_ns, row in rows.items():
        ledger.add(AS_MEASURED, t_ns, row.measured)
        ledger.add(EXTRINSIC, t_ns, row.measured.less(extrinsic))
    for t_ns, each in told.items():
        measured = rows[t_ns].measured
        if math.isfinite(late_s):
            ledger.add(SYNCHRONISATION, t_ns, measured.less(late_s * each.slope_rates))
        seen, unbiased = each.error_without_depth(np.zeros(3)), each.error_without_depth(bias_B)
        if seen is not None and unbiased is not None:
            ledger.add(DEPTH, t_ns, seen)
            ledger.add(IMU, t_ns, measured.less(seen.slopes - unbiased.slopes))
    for t_ns, error in with_true_attitude.items():
        ledger.add(ORIENTATION, t_ns, error)
    x, y, z = np.degrees(bias_B).tolist()
    ahead, across = np.degrees(extrinsic).tolist()
    return ledger, Explained(imu_bias_deg=(x, y, z), extrinsic_deg=(ahead, across), late_s=late_s)


def _replayed(source: ReplaySource) -> tuple[dict[int, _Row], dict[int, SlopeError]]:
    """Return the valid frames that have a truth, by their stamp, and their errors with the true attitude."""
    foothold = source.configuration.foothold
    pipeline, ground = Pipeline(source.calibration, foothold), GroundEstimator(source.calibration, foothold)
    truth_of, attitudes = _truths(source), ToldAttitudes()
    rows: dict[int, _Row] = {}
    with_true_attitude: dict[int, SlopeError] = {}
    newest: deque[Frame] = deque(maxlen=2)
    for message in source.inputs():
        if isinstance(message, Frame):
            newest.append(message)
        for estimate in pipeline.step(message):
            if isinstance(estimate, Attitude):
                attitudes.add(estimate)
            if not isinstance(estimate, GroundPlane) or estimate.status is not Status.VALID:
                continue
            t_ns = estimate.t_exposure_ns
            told, found = attitudes.at(t_ns), truth_of(t_ns)
            if found is None or found[1].transition:
                continue
            true_R_WB, truth = found
            rows[t_ns] = _Row(error_of(estimate, truth), told, true_R_WB, truth)
            for frame in newest:
                if frame.header.t_exposure_ns == t_ns:
                    w_WB_B = (0.0, 0.0, 0.0) if told is None else told.w_WB_B
                    again = ground.estimate(frame, true_R_WB, w_WB_B, np.zeros((3, 3)))
                    if again.status is Status.VALID:
                        with_true_attitude[t_ns] = error_of(again, truth)
    return rows, with_true_attitude


def _truths(source: ReplaySource) -> Callable[[int], tuple[FloatArray, GroundTruth] | None]:
    """Return what gives the true attitude (3, 3) and ground of a frame by its stamp, or None."""
    of_rig, poses, p_BE_m = source.rig_truth(), source.poses, np.array(source.calibration.X_BE.p_m)

    def recorded(t_ns: int) -> tuple[FloatArray, GroundTruth] | None:
        truth = of_rig.get(t_ns)
        return None if truth is None else (so3.matrix_from_quaternion(truth.q_WB), truth)

    def over_level_floor(t_ns: int) -> tuple[FloatArray, GroundTruth] | None:
        pose = None if poses is None else pose_at(poses, t_ns)
        if pose is None:
            return None
        R_WB, p_WB = pose
        floor = GroundTruth(
            t_exposure_ns=t_ns,
            slope_sagittal_rad=0.0,
            slope_frontal_rad=0.0,
            height_m=float((p_WB + R_WB @ p_BE_m)[2]),
            q_WB=so3.quaternion_from_matrix(R_WB),
            kind="level",
            transition=False,
            standing=False,
        )
        return R_WB, floor

    return recorded if of_rig else over_level_floor


class _Told:
    """What the attitude that was told for a frame makes of its errors."""

    def __init__(self, row: _Row, told: AttitudeAt, R_BE: FloatArray) -> None:
        self._row, self._told, self._R_BE = row, told, R_BE

    @property
    def measured(self) -> FloatArray:
        """Return the errors of the slopes as measured, (2,)."""
        return self._row.measured.slopes

    @property
    def tilt_B(self) -> FloatArray:
        """Return the rotation (3,) in B that takes the true vertical, as B sees it, to where the estimate has it."""
        tilt: FloatArray = np.cross(self._row.true_R_WB[2], self._told.R_WB[2])
        return tilt

    @property
    def slope_rates(self) -> FloatArray:
        """Return how fast the slopes (2,) turn by what the IMU tells, rad/s: −ω_y ahead, ω_x across, in H."""
        R_WH = heading(self._told.R_WB @ self._R_BE)
        if R_WH is None:
            return np.zeros(2)
        x, y, _ = R_WH.T @ self._told.R_WB @ np.array(self._told.w_WB_B)
        return np.array((-y, x))

    def error_without_depth(self, less_B: FloatArray) -> SlopeError | None:
        """Return what the attitude, without a tilt of `less_B` (3,), makes of the true plane."""
        told_R_WC = self._told.R_WB @ so3.exp(less_B) @ self._R_BE
        return error_of_attitude(told_R_WC, self._row.true_R_WB @ self._R_BE, self._row.truth)


def _late_s(told: list[_Told]) -> float:
    """Return δ of slopes = constant + δ · rates, by least squares; NaN where hardly anything turns."""
    if not told:
        return math.nan
    rates, slopes = (
        np.array(each) - np.mean(each, axis=0)
        for each in ([each.slope_rates for each in told], [each.measured for each in told])
    )
    if rms(rates) < _LEAST_RATE_RADPS:
        return math.nan
    return float(np.sum(rates * slopes) / np.sum(rates**2))
