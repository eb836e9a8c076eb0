"""The wearer's height, as the camera sees it: how high above the ground it is while the wearer stands and walks."""

import numpy as np

from calib.strict_yaml import CalibrationError
from messages import CAMERA_HEIGHTS_M, Estimate, GroundPlane, Motion, Status, WearerHeight

LEAST_VALID_FRAMES = 150
LEAST_STANDING_FRAMES = 40
LEAST_WALKING_FRAMES = 100
STANDING_MPS = 0.1
WALKING_MPS = 0.4
MOST_APART_M = 0.06
"""Standing and walking upright differ by less: who is farther off has sat, bent or stood before a step."""


class WearerMeasurement:
    """Collects what the pipeline tells of half a minute of standing and walking."""

    def __init__(self) -> None:
        self.frames = 0
        self._grounds: dict[int, GroundPlane] = {}
        self._seen: list[tuple[float, float, float]] = []

    def add(self, estimate: Estimate) -> None:
        """Take one estimate; those that are neither ground nor motion are left out."""
        if isinstance(estimate, GroundPlane):
            self.frames += estimate.frame_seq >= 0
            if estimate.status is Status.VALID:
                self._grounds[estimate.t_exposure_ns] = estimate
        elif isinstance(estimate, Motion) and estimate.status is Status.VALID:
            ground = self._grounds.pop(estimate.t_exposure_ns, None)
            if ground is not None:
                speed_mps = float(np.hypot(*estimate.velocity_H_mps[:2]))
                self._seen.append((ground.height_m, ground.covariance[5], speed_mps))

    def height(self, where: str) -> WearerHeight:
        """Return the median height while standing, with what it may be off by, 1 σ.

        That is its stated deviation, the scatter while standing, and half of what walking differs by on the average.
        Raises CalibrationError, one line that begins with `where`, where it cannot be measured.
        """
        if len(self._seen) < LEAST_VALID_FRAMES:
            raise CalibrationError(
                f"{where}: {len(self._seen)} of {self.frames} frames show valid ground and motion, allowed from "
                f"{LEAST_VALID_FRAMES}: stand and walk for half a minute over ground that has texture"
            )
        height_m, variance_m2, speed_mps = np.array(self._seen).T
        standing, walking = speed_mps < STANDING_MPS, speed_mps > WALKING_MPS
        for name, found, least in (
            ("standing", standing, LEAST_STANDING_FRAMES),
            ("walking", walking, LEAST_WALKING_FRAMES),
        ):
            if np.count_nonzero(found) < least:
                raise CalibrationError(
                    f"{where}: {np.count_nonzero(found)} valid frames of {name} found, allowed from {least}: "
                    "stand for some seconds and walk for more"
                )
        walking_m = float(np.median(height_m[walking]))
        upright = standing & (np.abs(height_m - walking_m) < MOST_APART_M)
        if np.count_nonzero(upright) < LEAST_STANDING_FRAMES:
            raise CalibrationError(
                f"{where}: the camera is {np.median(height_m[standing]):.3f} m high while standing and "
                f"{walking_m:.3f} m while walking, allowed {1e3 * MOST_APART_M:.0f} mm apart: stand upright, "
                "not before a step"
            )
        standing_m = float(np.median(height_m[upright]))
        low_m, high_m = CAMERA_HEIGHTS_M
        if not low_m <= standing_m <= high_m:
            raise CalibrationError(f"{where}: the camera is {standing_m:.3f} m high, allowed {low_m:g} to {high_m:g} m")
        scatter_m = 1.4826 * float(np.median(np.abs(height_m[upright] - standing_m)))
        variance = float(variance_m2[upright].mean()) + scatter_m**2 + 0.25 * (walking_m - standing_m) ** 2
        return WearerHeight(camera_height_m=round(standing_m, 4), std_m=round(max(1e-3, variance**0.5), 4))
