"""How the camera moved between two frames: stereo visual odometry, its rows put right by the IMU.

Corners of the left picture get their distance from the right one and are followed into the next left picture; the
rigid motion that moves them so is found by robust least squares. The IMU tells only how the motion differs from row to
row within a step, where to look, and which of two rigid bodies is the ground. The mean rate and velocity of a step
come from the pictures alone, so that each can judge the other; and no ground is assumed: kerbs, stairs and walls serve
as well.

Consecutive steps share a picture and the distances found in it, so their errors are not independent.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from messages import StereoCalibration
from messages.arrays import BoolArray, Float32Array, FloatArray, GreyImage
from perception import so3
from perception.motion.bent_distances import Bend
from perception.motion.distance_jump import DistanceJumps
from perception.motion.eye_alignment import RowSkew
from perception.motion.inner_motion import InnerMotion, steady_motion
from perception.motion.mirrored import Mirrored
from perception.motion.rigid_step import PointsInStep, RigidStepSettings, solve
from perception.motion.sheared import Shear
from perception.motion.stereo_points import StereoPoints, View
from perception.motion.torn import Torn


@dataclass(frozen=True)
class EgoMotion:
    """The mean motion of C between two exposures.

    `t_before_ns` and `t_after_ns` are mid-exposures of two frames. `w_C_radps` and `v_C_mps` (3,) are angular rate and
    velocity, in C as it was before; `covariance` (6, 6) is that of both, rate first; `common_rad` is what of the turn's
    deviation the steps around it share. `bend` is what the step tells of the distances that it rests on.
    """

    t_before_ns: int
    t_after_ns: int
    w_C_radps: FloatArray
    v_C_mps: FloatArray
    covariance: FloatArray
    common_rad: float
    tracks: int
    bend: Bend


class _Pair(NamedTuple):
    """The reduced pictures of one frame."""

    t_exposure_ns: int
    left: GreyImage
    right: GreyImage


class VisualOdometer:
    """Follows the motion of C from frame to frame.

    `skew` is how the eyes' rows differ in the newest pair; `jumps` tell whether all distances have jumped, and `torn`
    whether pictures are of two instants. By `moved` (of a ray's tangent) corners moved in the newest step, half of them
    by less; infinite where that is unknown.
    """

    longest_step_s = 0.125  # one frame of 20 Hz may be missing: later, nobody knows where to look for a corner
    longest_foretold_step_s = 0.3  # but the IMU, while what is seen is still much the same
    most_travel_m = 0.32
    most_turn_rad = 0.3
    least_tracks = 12  # for six unknowns, of which some are wrong
    # What all corners share: blur that changes, rounding to pixels, the ground that a window sees come nearer.
    common_radps = 0.0012
    common_mps = 0.002

    def __init__(self, stereo: StereoCalibration) -> None:
        self.raw_size_px = (stereo.left.width_px, stereo.left.height_px)
        self._stereo = StereoPoints(stereo)
        self.R_LC = self._stereo.R_LC
        self.longest_row_time_s = self._stereo.longest_row_time_s
        self._settings = RigidStepSettings(f_px=self._stereo.left.f_px, least_points=self.least_tracks)
        self._common = np.diag(np.repeat((self.common_radps**2, self.common_mps**2), 3))
        self._last_rates: FloatArray = np.zeros(6)
        self._view: View | None = None
        self._unprepared: _Pair | None = None
        self.skew: RowSkew | None = None
        self.jumps = DistanceJumps()
        self.moved = math.inf
        self._mirrored = Mirrored()
        self.torn = Torn()
        self._expected: tuple[Float32Array, FloatArray] | None = None  # corners of the newest pair, and their depths

    @property
    def last_v_C_mps(self) -> FloatArray:
        """Return the velocity (3,) of the newest step; 0 where it is not known."""
        return self._last_rates[3:]

    @property
    def common_error(self) -> float:
        """Return by about how much corners err alike, of a ray's tangent: (1) of `mirrored`, of the newest steps."""
        return self._mirrored.common_error

    @property
    def t_before_ns(self) -> int | None:
        """Return the mid-exposure at which the next step will begin; None before the first frame."""
        if self._unprepared is not None:
            return self._unprepared.t_exposure_ns
        return None if self._view is None else self._view.t_exposure_ns

    def add_frame(
        self, t_exposure_ns: int, left: GreyImage, right: GreyImage, inner: InnerMotion | None = None
    ) -> EgoMotion | None:
        """Take a raw pair, (height, width) uint8 of the calibrated size; return the motion since the one before.

        `inner` is how C moved meanwhile as the IMU felt it, from `t_before_ns` on; without it the motion counts as
        steady. None at the start, after a gap in which corners may have moved too far, and where too little can be
        followed.
        """
        self.prepare_next()
        before, self.moved = self._view, math.inf
        self._unprepared = _Pair(t_exposure_ns, self._stereo.detail(left), self._stereo.detail(right))
        if before is None or not self._can_follow(1e-9 * (t_exposure_ns - before.t_exposure_ns), inner):
            return None
        motion = self._motion(before, self._unprepared, inner)
        self._judge_distances(self._unprepared)
        return motion

    def prepare_next(self) -> None:
        """Find what to follow into the next frame: two thirds of the work, best done when no estimate waits for it."""
        if self._unprepared is not None:
            self._view, self.skew = self._stereo.view(*self._unprepared)
            self._unprepared = None

    def _can_follow(self, step_s: float, inner: InnerMotion | None) -> bool:
        """Return whether corners of `step_s` ago can be found again."""
        if 0.0 < step_s < self.longest_step_s:
            return True
        if not 0.0 < step_s < self.longest_foretold_step_s or inner is None or inner.foretold is None:
            return False
        R, p_m = inner.at(np.array([step_s]))
        return bool(np.linalg.norm(p_m[0]) < self.most_travel_m and np.linalg.norm(so3.log(R[0])) < self.most_turn_rad)

    def _motion(self, before: View, pair: _Pair, inner: InnerMotion | None) -> EgoMotion | None:
        """Return the motion as the IMU has it, or else, where that is refuted, as it was in the step before."""
        if len(before.points_C) < self.least_tracks:
            return None
        motion = None if inner is None else self._motion_within(before, pair, inner)
        if motion is None and 1e-9 * (pair.t_exposure_ns - before.t_exposure_ns) < self.longest_step_s:
            motion = self._motion_within(before, pair, steady_motion(self._last_rates))
            if motion is not None and inner is not None and motion.tracks < self._settings.least_surprising:
                motion = None
        self._last_rates = np.zeros(6) if motion is None else np.concatenate((motion.w_C_radps, motion.v_C_mps))
        return motion

    def _judge_distances(self, pair: _Pair) -> None:
        """Compare what `pair` shows with where its corners should be after the step."""
        if self._expected is not None:
            corners_px, depth_m = self._expected
            off_px, good = self._stereo.off_px(pair.left, pair.right, corners_px, depth_m)
            self.jumps.add(corners_px[good], off_px[good])
        self._expected = None

    def _guess_noise_px(self, inner: InnerMotion, step_s: float) -> float:
        """Return about how far from where they are foretold corners may be."""
        if inner.foretold is None:
            return math.inf
        variances = inner.foretold.diagonal().tolist()
        rate_radps, velocity_mps = math.sqrt(max(variances[:3])), math.sqrt(max(variances[3:]))
        return self._settings.f_px * step_s * (rate_radps + velocity_mps / _USUAL_DEPTH_M)

    def _motion_within(self, before: View, pair: _Pair, inner: InnerMotion) -> EgoMotion | None:
        step_s = 1e-9 * (pair.t_exposure_ns - before.t_exposure_ns)
        R, p_m = inner.at(np.array([step_s]))
        guess_px = np.clip(self._stereo.left.pixels((before.points_C - p_m) @ R[0]), -_OUTSIDE_PX, _OUTSIDE_PX)
        levels = 0 if self._guess_noise_px(inner, step_s) < _NEAR_PX else 2
        seen_px, good = Shear(before.corners_px, guess_px).tracked(before.left, pair.left, levels)
        carried = good & _is_carried(before.corners_px, guess_px, seen_px)
        if np.count_nonzero(carried) < self._settings.majority * np.count_nonzero(good):
            good &= ~carried
        if np.count_nonzero(good) < self.least_tracks:
            return None
        seen_px, points_C = seen_px[good], before.points_C[good]
        to_s = step_s + self._stereo.row_times_s(seen_px)
        disparity, rays = self._stereo.baseline_m / points_C[:, 2], self._stereo.left.rays_C(seen_px)[:, :2]
        points = PointsInStep(points_C, disparity, before.row_time_s[good], to_s, inner)
        step = solve(points, rays, inner.foretold, self._settings)
        if step is None:
            if self.jumps.contradict:  # with wrong distances few steps are found: may the eyes have jumped back?
                self._expected = seen_px, points.moved(np.zeros(6))[2]
            return None
        self._expected = seen_px[step.agrees], points.moved(step.rates)[2][step.agrees]
        noise = inner.noise if step.likely else steady_motion(self._last_rates).noise
        moved_px = np.linalg.norm(seen_px - before.corners_px[good], axis=1)
        self.moved = float(np.median(moved_px)) / self._settings.f_px
        self._mirrored.add(step.disagreeing, step.noise)
        if self._last_rates.any():  # the step before was seen
            as_before = PointsInStep(
                points_C, disparity, before.row_time_s[good], to_s, steady_motion(self._last_rates)
            )
            off_px, off_before_px = points.off(step.rates, rays), as_before.off(np.zeros(6), rays)
            self.torn.add(self._settings.f_px * off_px, self._settings.f_px * off_before_px)
        common = self.common_error / step_s * _RATES_PER_TANGENT
        return EgoMotion(
            t_before_ns=before.t_exposure_ns,
            t_after_ns=pair.t_exposure_ns,
            w_C_radps=so3.log(R[0] @ so3.exp(step.rates[:3] * step_s)) / step_s,
            v_C_mps=step.rates[3:] + p_m[0] / step_s,
            covariance=step.covariance + self._common + np.diag(noise**2 + common**2),
            common_rad=self.common_error,
            tracks=step.inliers,
            bend=step.bend,
        )


def _is_carried(before_px: Float32Array, foretold_px: Float32Array, seen_px: Float32Array) -> BoolArray:
    """Return which corners (N, 2) stay where they were in the picture, although they were foretold to move: the wearer
    carries what they are on. While the wearer has hardly begun to move that differs from the ground by less than any
    bound that tells other bodies apart."""
    foretold = np.linalg.norm(foretold_px - before_px, axis=1)
    moved = np.linalg.norm(seen_px - before_px, axis=1)
    carried: BoolArray = (foretold > _TOLD_PX) & (moved < np.minimum(0.5 * foretold, _STAYS_PX))
    return carried


_TOLD_PX, _STAYS_PX = 0.08, 0.3
"""Twice what tracking leaves; and what it leaves where a carried thing's edge is blurred over the ground."""
_OUTSIDE_PX = np.float32(1e4)
"""What a velocity that the IMU has lost puts beside the camera is anywhere out of the picture; so far is enough."""
_NEAR_PX = 1.0
"""Deviation of a guess from which tracking finds the corner without a coarser picture."""
_USUAL_DEPTH_M = 1.0
_RATES_PER_TANGENT = np.repeat((1.0, _USUAL_DEPTH_M), 3)
"""Turn, rad, and travel, m, that move what is seen by a tangent of 1."""
