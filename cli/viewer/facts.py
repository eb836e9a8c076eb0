"""From estimates to what the page shows of them: points of the charts, numbers in words, health, latencies."""

import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from cli.viewer.board import Board
from daemon.pipeline import NO_FRAME_SEQ
from messages import Attitude, Estimate, GroundPlane, GroundTruth, Health, Motion, Status, Terrain, UnitCalibration
from messages.constants import NORMAL_95
from messages.estimates import full_matrix
from perception import so3

NEWEST = 200
"""So many latencies count: of 10 s."""


class Facts:
    """Tells a board of each estimate. `truth` returns that of a ground, where a rig knows it."""

    def __init__(
        self,
        board: Board,
        calibration: UnitCalibration,
        truth: Callable[[GroundPlane], GroundTruth | None] = lambda _ground: None,
    ) -> None:
        self._board = board
        self._R_BE = np.array(calibration.X_BE.R)
        self._truth = truth
        self._first_ns: int | None = None
        self._tilt: tuple[float | None, ...] = (None, None)
        self._latencies_ms: deque[float] = deque(maxlen=NEWEST)

    def add(self, estimate: Estimate, latency_s: float) -> None:
        """Take one estimate; `latency_s` from exposure to publication counts for the ground, NaN where unknown."""
        if isinstance(estimate, GroundPlane):
            self._add_ground(estimate, latency_s)
        elif isinstance(estimate, Attitude):
            self._add_attitude(estimate)
        elif isinstance(estimate, Motion):
            self._board.set_facts({"motion": _motion_words(estimate)})
        elif isinstance(estimate, Terrain):
            self._board.set_facts({"terrain": _terrain_words(estimate)})
        elif isinstance(estimate, Health):
            self._board.set_facts({"health": health_rows(estimate)})

    def restart(self) -> None:
        """Forget what came: a recording begins again."""
        self._first_ns = None
        self._latencies_ms.clear()
        self._board.clear_points()

    def _add_ground(self, ground: GroundPlane, latency_s: float) -> None:
        self._first_ns = ground.t_exposure_ns if self._first_ns is None else self._first_ns
        latency_ms = None if math.isnan(latency_s) or ground.frame_seq == NO_FRAME_SEQ else 1e3 * latency_s
        if latency_ms is not None:
            self._latencies_ms.append(latency_ms)
        truth = self._truth(ground)
        self._board.add_point(
            (
                1e-9 * (ground.t_exposure_ns - self._first_ns),
                *_with_band(math.degrees(ground.slope_sagittal_rad), math.degrees(_sd(ground.covariance[0]))),
                _known(math.degrees(ground.slope_frontal_rad)),
                None if truth is None else _known(math.degrees(truth.slope_sagittal_rad)),
                *_with_band(100.0 * ground.height_m, 100.0 * _sd(ground.covariance[5])),
                None if truth is None else _known(100.0 * truth.height_m),
                *self._tilt,
                latency_ms,
            )
        )
        self._board.set_facts(
            {
                "status": ground.status.value,
                "ground": _ground_words(ground),
                "latency": _latency_words(self._latencies_ms),
            }
        )

    def _add_attitude(self, attitude: Attitude) -> None:
        if attitude.status is not Status.VALID:
            self._tilt = (None, None)
            self._board.set_facts({"attitude": f"none: {attitude.reason.value}"})
            return
        R_WE = so3.matrix_from_quaternion(attitude.q_WB) @ self._R_BE
        down_deg = math.degrees(math.asin(np.clip(-R_WE[2, 2], -1.0, 1.0)))
        roll_deg = math.degrees(math.asin(np.clip(-R_WE[2, 0], -1.0, 1.0)))
        self._tilt = (down_deg, roll_deg)
        sd_deg = math.degrees(
            math.sqrt(max(np.linalg.eigvalsh(full_matrix(attitude.rotation_cov_W_rad2)[:2, :2])[1], 0))
        )
        self._board.set_facts(
            {"attitude": f"camera {down_deg:.1f}° down, {roll_deg:+.1f}° to the right, vertical ±{sd_deg:.2f}°"}
        )


def health_rows(health: Health) -> list[tuple[str, str]]:
    """Return what the page's table of health says, a name and a value a row."""
    dropped = ", ".join(f"{count} {cause.value}" for cause, count in health.frames_dropped.items() if count)
    refused = ", ".join(f"{count} {reason.value}" for reason, count in health.refused.items() if count)
    return [
        ("frames", f"{health.frames}, {health.frames_valid} with valid ground"),
        ("frames dropped", dropped or "none"),
        ("no ground because", refused or "—"),
        ("IMU samples", f"{health.imu_samples}, {health.imu_lost} lost, {health.imu_refused} refused"),
        ("I2C errors, resets", f"{health.imu_bus_errors}, {health.imu_resets}"),
        ("CAN, Zenoh errors", f"{health.can_errors}, {health.zenoh_errors}"),
        ("recording", f"{health.recording.value}, {health.recorder_dropped} dropped"),
        ("load", health.load.value),
        ("wearer's height", "contradicts the ground" if health.height_contradicts else "agrees or unknown"),
    ]


def _with_band(value: float, sd: float) -> tuple[float | None, float | None, float | None]:
    """Return a value with the ends of its 95 % interval."""
    return _known(value), _known(value - NORMAL_95 * sd), _known(value + NORMAL_95 * sd)


def _known(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def _sd(variance: float) -> float:
    return math.sqrt(variance) if variance >= 0.0 else math.nan


def _ground_words(ground: GroundPlane) -> str:
    if ground.status is not Status.VALID:
        return f"no ground: {ground.reason.value}"
    return (
        f"slope {math.degrees(ground.slope_sagittal_rad):+.1f}° ahead, {math.degrees(ground.slope_frontal_rad):+.1f}° "
        f"across, {100.0 * ground.height_m:.1f} cm below the camera"
    )


def _motion_words(motion: Motion) -> str:
    if motion.status is not Status.VALID:
        return f"none: {motion.reason.value}"
    rides = ", on a ground that moves" if motion.ground_moves else ""
    return f"{math.hypot(*motion.velocity_H_mps[:2]):.2f} m/s, {motion.distance_m:.1f} m walked{rides}"


def _terrain_words(terrain: Terrain) -> str:
    if terrain.status is not Status.VALID:
        return f"none: {terrain.reason.value}"
    ahead = [edge for edge in terrain.edges if edge.distance_m > 0.0]
    edge = f", edge {100.0 * ahead[0].rise_m:+.1f} cm at {ahead[0].distance_m:.2f} m" if ahead else ""
    return f"{terrain.kind.value.replace('_', ' ')} {terrain.probability:.0%}{edge}"


def _latency_words(latencies_ms: Sequence[float]) -> str:
    if not latencies_ms:
        return "—"
    p50, p99 = np.percentile(latencies_ms, (50, 99))
    return f"p50 {p50:.0f}, p99 {p99:.0f}, most {max(latencies_ms):.0f} ms, of the last {len(latencies_ms)}"
