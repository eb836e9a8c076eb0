"""How far the camera has gone over the ground it sees: the length of its horizontal path, from its steps.

Steps carry noise, and a wearer who stands sways: summed one by one both would pass for way. So the path is taken for a
chain of chords c, each over as many steps as make `CHORD_M`:

    D = Σ |c|,   var D = Σ_steps n² + (Σ_chords |c| σ_s)²                                    (1)

with n the noise of a step, independent of the others', and σ_s the deviation of the distances' scale, common to all.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray
from perception import so3
from perception.attitude.camera_step import CameraStep

CHORD_M = 0.1
"""Well above a standing person's sway, well below the radius of a turn: it cuts off (chord / radius)² / 24 of that."""


class Way(NamedTuple):
    """A distance in m, and its variance in m²."""

    distance_m: float
    variance_m2: float


class Travel(NamedTuple):
    """A displacement (3,), m, or a velocity, m/s, in W, with its covariance (3, 3)."""

    mean_W: FloatArray
    covariance_W: FloatArray

    @property
    def variance_along(self) -> float:
        """Return the variance of its horizontal length; where that is nothing, of its less certain direction."""
        length = math.hypot(self.mean_W[0], self.mean_W[1])
        if length == 0.0:
            return float(max(self.covariance_W[0, 0], self.covariance_W[1, 1]))
        way = np.array([self.mean_W[0], self.mean_W[1], 0.0]) / length
        return float(way @ self.covariance_W @ way)


@dataclass
class PathLength:
    """The chords so far, and the one that has begun, to which the steps are added in their order."""

    chords_m: float = 0.0
    noise_var_m2: float = 0.0
    scale_error_m: float = 0.0
    scale_std: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    end_ns: int | None = None

    def add_step(self, step: CameraStep, R_W1: FloatArray, noise_factor: float, scale: float, scale_std: float) -> None:
        """Take a step after which the attitude is `R_W1`, and whose distances are (1 + `scale`) times the true ones.

        Its rows may have been exposed a little before the end of the step before, or after: it counts from there on.
        """
        R_W0 = R_W1 @ so3.exp(-np.array(step.turn_B))
        since_ns = step.t_before_ns if self.end_ns is None else self.end_ns
        share = (step.t_after_ns - since_ns) / (step.t_after_ns - step.t_before_ns) / (1.0 + scale)
        noise_W = (noise_factor * share) ** 2 * R_W0 @ step.covariance[3:, 3:] @ R_W0.T
        self._add(step.t_after_ns, Travel(share * R_W0 @ np.array(step.travel_B), noise_W), scale_std)

    def add_unseen(self, t_ns: int, travel: Travel | None) -> None:
        """Take what the camera did not see until `t_ns`, and the samples tell; None where they do not either."""
        if travel is not None:
            self._add(t_ns, travel, 0.0)

    def interrupt(self, t_ns: int, speed_mps: float) -> None:
        """Go on at `t_ns` in another W. What was gone meanwhile is not known: nothing is added but its variance, for a
        pace with the deviation `speed_mps`."""
        self._end_chord()
        if self.end_ns is not None:
            self.noise_var_m2 += (speed_mps * 1e-9 * (t_ns - self.end_ns)) ** 2
        self.end_ns = t_ns

    def at(self, t_ns: int, velocity: Travel) -> Way:
        """Return the way until `t_ns`, soon after the newest step, from which on the camera moves at `velocity`."""
        since_s = 0.0 if self.end_ns is None else 1e-9 * (t_ns - self.end_ns)
        v_x, v_y, _ = velocity.mean_W
        chord_m = math.hypot(self.x_m + v_x * since_s, self.y_m + v_y * since_s)
        scale_error_m = self.scale_error_m + chord_m * self.scale_std
        noise_var_m2 = self.noise_var_m2 + velocity.variance_along * since_s**2
        return Way(self.chords_m + chord_m, noise_var_m2 + scale_error_m**2)

    def _add(self, t_ns: int, travel: Travel, scale_std: float) -> None:
        self.end_ns, self.scale_std = t_ns, scale_std
        self.x_m += float(travel.mean_W[0])
        self.y_m += float(travel.mean_W[1])
        self.noise_var_m2 += travel.variance_along
        if math.hypot(self.x_m, self.y_m) >= CHORD_M:
            self._end_chord()

    def _end_chord(self) -> None:
        chord_m = math.hypot(self.x_m, self.y_m)
        self.chords_m += chord_m
        self.scale_error_m += chord_m * self.scale_std
        self.x_m = self.y_m = 0.0
