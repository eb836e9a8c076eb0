"""Estimates of the ground against the rig's truth, on each kind of ground."""

from collections import defaultdict

import msgspec
import numpy as np

from messages import GroundPlane, GroundTruth, Status
from messages.constants import NORMAL_95


class Score(msgspec.Struct, frozen=True, kw_only=True):
    """Accuracy on one kind of ground. Errors are RMS over the valid frames, that of the slope ahead also the error that
    1 % of them exceed; NaN where there are none.

    `coverage` is the share of the three numbers that lie in their own stated 95 % interval.
    """

    frames: int
    valid_share: float
    slope_sagittal_rms_deg: float
    slope_sagittal_p99_deg: float
    slope_frontal_rms_deg: float
    height_rms_mm: float
    coverage: float


STARTING = "starting"


class Scoreboard:
    """Collects one row of six numbers a frame, so that an hour of walking costs some 20 MB."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[float, ...]]] = defaultdict(list)

    def add(self, ground: GroundPlane, truth: GroundTruth) -> None:
        """Take the estimate of one frame and its truth."""
        std = np.sqrt(np.array([ground.covariance[i] for i in (0, 3, 5)]))
        error = (
            ground.slope_sagittal_rad - truth.slope_sagittal_rad,
            ground.slope_frontal_rad - truth.slope_frontal_rad,
            ground.height_m - truth.height_m,
        )
        self._rows[self._ground_under(ground, truth)].append((*error, *std))

    def take(self, other: "Scoreboard") -> None:
        """Take all that `other` has collected."""
        for kind, rows in other._rows.items():
            self._rows[kind] += rows

    @staticmethod
    def _ground_under(ground: GroundPlane, truth: GroundTruth) -> str:
        if ground.status is Status.INITIALISING:
            return STARTING
        if truth.transition:
            return "transition"
        return "standing" if truth.standing else truth.kind

    def summary(self) -> dict[str, Score]:
        """Return the score of each kind of ground met, and of all frames after the start together."""
        scores = {kind: _score(rows) for kind, rows in sorted(self._rows.items()) if kind != STARTING}
        return scores | {"all": _score([row for kind, rows in self._rows.items() if kind != STARTING for row in rows])}


def _score(rows: list[tuple[float, ...]]) -> Score:
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    valid = table[np.isfinite(table).all(axis=1)]
    error, std = valid[:, :3], valid[:, 3:]
    if len(valid) == 0:
        rms, p99, coverage = np.full(3, np.nan), np.nan, np.nan
    else:
        rms = np.sqrt((error**2).mean(axis=0))
        p99 = float(np.quantile(np.abs(error[:, 0]), 0.99))
        coverage = float((np.abs(error) <= NORMAL_95 * std).mean())
    return Score(
        frames=len(table),
        valid_share=len(valid) / len(table) if len(table) else np.nan,
        slope_sagittal_rms_deg=float(np.degrees(rms[0])),
        slope_sagittal_p99_deg=float(np.degrees(p99)),
        slope_frontal_rms_deg=float(np.degrees(rms[1])),
        height_rms_mm=float(1e3 * rms[2]),
        coverage=coverage,
    )
