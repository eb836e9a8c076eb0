"""How the camera moved between two frames, from the pictures and the lenses alone: stereo visual odometry.

Corners of the left picture get their distance from the right one and are followed into the next left picture; the
rigid motion that moves them so is found by robust least squares. Nothing of it comes from the IMU, so that each can
judge the other, and no ground is assumed: kerbs, stairs and walls serve as well.

A point at X in C, while C turns at ω and moves at v (both in C) for a time Δt, is seen next at

    X' = exp(−[ω]× Δt) (X − v Δt),                                                            (1)

with Δt its own: between the exposures of the two rows that show it (rolling shutter). Derivatives of the picture
x = X/Z, y = Y/Z by ω and v: the equations of optical flow (Longuet-Higgins, Prazdny 1980).

Rows high in the picture show an earlier Δt than low ones. Where the motion changes, that passes for a motion across
the rows: least squares finds (ω, v) + A d(ω, v)/dt, with A known from the rows (16 ms times the rate's change for the
pitch of a ZED). The rates of the steps before and after tell the change, so each step is told one frame late; of the
newest step, a first guess follows from the change since the step before.                                          (2)
"""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import msgspec
import numpy as np

from messages import Lens, StereoCalibration
from messages.arrays import BoolArray, Float32Array, FloatArray, GreyImage
from perception.depth.matcher import DisparityRange, SemiGlobalMatcher
from perception.depth.rectify import Rectifier, Window, intrinsics
from perception.so3 import skew


@dataclass(frozen=True)
class EgoMotion:
    """The mean motion of C between two exposures.

    `t_before_ns` and `t_after_ns` are those of the rows that were followed, on average. `w_C_radps` and `v_C_mps` (3,)
    are angular rate and velocity, in C as it was before; `covariance` (6, 6) is that of both, rate first.
    """

    t_before_ns: int
    t_after_ns: int
    w_C_radps: FloatArray
    v_C_mps: FloatArray
    covariance: FloatArray
    tracks: int


@dataclass(frozen=True)
class _Step:
    """What least squares makes of one step: (ω, v), its covariance and A of (2), each (6, 6)."""

    t_before_ns: int
    t_after_ns: int
    rates: FloatArray
    covariance: FloatArray
    row_lag_s: FloatArray
    tracks: int

    @property
    def middle_s(self) -> float:
        return 0.5e-9 * (self.t_before_ns + self.t_after_ns)


@dataclass(frozen=True)
class _View:
    """One frame: its reduced left picture, corners (N, 2) in it, their points in C (N, 3) and when each was exposed."""

    t_exposure_ns: int
    left: GreyImage
    corners_px: Float32Array
    points_C: FloatArray
    row_time_s: FloatArray


class VisualOdometer:
    """Follows the motion of C from frame to frame.

    Works on pictures reduced to about `width_px`: corners are followed to a tenth of a pixel, which is enough. Where
    in the right eye a corner may be, dense matching at half that size tells. `skew_px` is by how many raw pixels the
    right eye sees the corners of the newest pair lower than the calibration says, their median; NaN if unknown.
    """

    # Pixels are those of the reduced picture, but for `skew_px` itself.
    width_px = 320
    corners = 60  # at most: three times what is needed, and little work
    corner_quality = 0.02  # of the best corner's, at least (OpenCV's measure): faint texture still has some
    corner_spacing_px = 12  # about a tracking window, so that corners differ and spread over the picture
    longest_step_s = 0.125  # one frame of 20 Hz may be missing: later, corners have moved too far
    least_tracks = 20  # for six unknowns, and for a median that outliers do not move
    most_return_px = 0.5  # a corner followed forth and back ends where it began
    most_skew_px = 1.0  # between the eyes' rows: a larger one is a false match
    most_skew_spread_px = 0.2  # median about the median: more, and the matches do not agree on any skew
    least_noise_px = 0.03  # of tracking, however still the picture
    most_noise_px = 0.5  # above it the corners do not move as one rigid body
    rounds = 4  # of Gauss-Newton: from the step before on, more change nothing

    def __init__(self, stereo: StereoCalibration) -> None:
        self.raw_size_px = (stereo.left.width_px, stereo.left.height_px)
        self._divisor = max(1, round(stereo.left.width_px / self.width_px))
        small = msgspec.structs.replace(
            stereo, left=_reduced(stereo.left, self._divisor), right=_reduced(stereo.right, self._divisor)
        )
        self._coarse = Rectifier(small, 2)
        self._matcher = SemiGlobalMatcher(self._coarse)
        self.R_LC = self._coarse.R_LC
        self._left = _Eye(small.left, self.R_LC.T)
        self._right = _Eye(small.right, self.R_LC.T @ np.array(stereo.X_RL.R).T)
        self._row_time_s = stereo.row_time_s
        self._middle_row = (stereo.left.height_px - 1) / 2
        self._view: _View | None = None
        self._unprepared: tuple[int, GreyImage, GreyImage] | None = None
        self.skew_px = float("nan")
        self._steps: deque[_Step] = deque(maxlen=3)

    def add_frame(self, t_exposure_ns: int, left: GreyImage, right: GreyImage) -> EgoMotion | None:
        """Take a raw pair, (height, width) uint8 of the calibrated size; return the motion of the step before last.

        None until three steps in a row are known: after the start, after a gap longer than `longest_step_s`, and after
        pictures in which too little can be followed.
        """
        self.prepare_next()
        before, left, right = self._view, self._small(left), self._small(right)
        step = None
        if before is not None and 0.0 < 1e-9 * (t_exposure_ns - before.t_exposure_ns) < self.longest_step_s:
            step = self._followed(before, t_exposure_ns, left)
        self._unprepared = (t_exposure_ns, left, right)
        if step is None:
            self._steps.clear()
            return None
        self._steps.append(step)
        return None if len(self._steps) < 3 else _corrected(*self._steps)

    def prepare_next(self) -> None:
        """Find what to follow into the next frame: two thirds of the work, best done when no estimate waits for it."""
        if self._unprepared is not None:
            self._view, self._unprepared = self._viewed(*self._unprepared), None

    @property
    def newest(self) -> EgoMotion | None:
        """Return a first guess at the motion of the newest step; None until two steps in a row are known."""
        if len(self._steps) < 2:
            return None
        before, step = self._steps[-2], self._steps[-1]
        return _corrected(before, step, step)

    def _small(self, image: GreyImage) -> GreyImage:
        """Return `image` reduced by the divisor; by halves as far as that goes, which is what OpenCV does fastest."""
        divisor = self._divisor
        if divisor == 1:
            return np.array(image)  # a frame's buffer is wanted back
        while divisor > 1:
            by = 2 if divisor % 2 == 0 else divisor
            height, width = image.shape
            image = cv2.resize(image, (width // by, height // by), interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
            divisor //= by
        return image

    def _viewed(self, t_exposure_ns: int, left: GreyImage, right: GreyImage) -> _View | None:
        """Find corners in a reduced pair, and their depth; None where there are too few."""
        self.skew_px = float("nan")
        corners_px = _corners(left, self.corners, self.corner_quality, self.corner_spacing_px)
        if len(corners_px) < self.least_tracks:
            return None
        rays_C = self._left.rays_C(corners_px)
        guess = self._coarse_disparity(left, right, rays_C)
        known = np.isfinite(guess)
        corners_px, rays_C, guess = corners_px[known], rays_C[known], guess[known]
        if len(corners_px) < self.least_tracks:
            return None
        away_C = rays_C - np.outer(guess, _X_AXIS)
        matched_px, good = _tracked(left, right, corners_px, self._right.pixels(away_C), levels=0)
        seen_C = self._right.rays_C(matched_px)
        disparity = rays_C[:, 0] - seen_C[:, 0]
        skew = seen_C[:, 1] - rays_C[:, 1]
        self.skew_px = self._divisor * self._left.f_px * self._common(skew[good])
        good &= np.abs(skew) < self.most_skew_px / self._left.f_px
        good &= np.abs(disparity - guess) < 1.0 / self._coarse.f_px
        if np.count_nonzero(good) < self.least_tracks:
            return None
        points_C = rays_C[good] * (self._coarse.baseline_m / disparity[good])[:, None]
        return _View(t_exposure_ns, left, corners_px[good], points_C, self._row_times_s(corners_px[good]))

    def _common(self, skew: FloatArray) -> float:
        """Return the median of `skew` (N,), in units of the focal length; NaN where few corners or no two agree."""
        if len(skew) < self.least_tracks:
            return float("nan")
        median = float(np.median(skew))
        spread_px = self._left.f_px * float(np.median(np.abs(skew - median)))
        return median if spread_px < self.most_skew_spread_px else float("nan")

    def _coarse_disparity(self, left: GreyImage, right: GreyImage, rays_C: FloatArray) -> FloatArray:
        """Return the disparity (N,) of rays (N, 3), in units of the focal length, to a pixel; NaN where unknown."""
        coarse = self._coarse
        whole = Window(0, coarse.height_px, 0, coarse.width_px)
        disparity_px = self._matcher.match(left, right, whole, _COARSE_SEARCH)
        u = np.rint(coarse.f_px * rays_C[:, 0] + coarse.cx_px).astype(np.intp)
        v = np.rint(coarse.f_px * rays_C[:, 1] + coarse.cy_px).astype(np.intp)
        inside = (u >= 0) & (u < coarse.width_px) & (v >= 0) & (v < coarse.height_px)
        found = np.full(len(rays_C), np.nan)
        found[inside] = disparity_px[v[inside], u[inside]] / coarse.f_px
        found[found < _LEAST_DISPARITY_PX / coarse.f_px] = np.nan
        return found

    def _row_times_s(self, points_px: Float32Array) -> FloatArray:
        """Return when (N,) the rows of reduced pixels (N, 2) were exposed, relative to mid-exposure."""
        raw_row = self._divisor * (points_px[:, 1].astype(np.float64) + 0.5) - 0.5
        return (raw_row - self._middle_row) * self._row_time_s

    def _followed(self, before: _View, t_exposure_ns: int, left: GreyImage) -> _Step | None:
        step_s = 1e-9 * (t_exposure_ns - before.t_exposure_ns)
        rates = self._steps[-1].rates if self._steps else np.zeros(6)
        predicted_px = self._left.pixels(_moved(before.points_C, rates, np.full(len(before.points_C), step_s)))
        seen_px, good = _tracked(before.left, left, before.corners_px, predicted_px, levels=2)
        back_px, returned = _tracked(left, before.left, seen_px, before.corners_px, levels=0)
        good &= returned & (np.abs(back_px - before.corners_px).max(axis=1) < self.most_return_px)
        if np.count_nonzero(good) < self.least_tracks:
            return None
        before_s, after_s = before.row_time_s[good], self._row_times_s(seen_px[good])
        intervals_s = step_s + after_s - before_s
        solved = self._solved(before.points_C[good], self._left.rays_C(seen_px[good])[:, :2], intervals_s, rates)
        if solved is None:
            return None
        mean_before_s, mean_after_s = (float(solved.weight @ times_s) for times_s in (before_s, after_s))
        off_middle_s = 0.5 * (before_s - mean_before_s + after_s - mean_after_s)
        return _Step(
            t_before_ns=before.t_exposure_ns + round(1e9 * mean_before_s),
            t_after_ns=t_exposure_ns + round(1e9 * mean_after_s),
            rates=solved.rates,
            covariance=solved.covariance,
            row_lag_s=np.einsum("inr,n,nrj->ij", solved.pull, off_middle_s, solved.flow),
            tracks=solved.inliers,
        )

    def _solved(
        self, points_C: FloatArray, seen: FloatArray, intervals_s: FloatArray, rates: FloatArray
    ) -> "_Solution | None":
        """Return (ω, v) from `rates` on by Gauss-Newton on (1) with Tukey's weights; None if too few points agree.

        `points_C` (N, 3) are seen at `seen` (N, 2), z = 1, after `intervals_s` (N,).
        """
        least, most = self.least_noise_px / self._left.f_px, self.most_noise_px / self._left.f_px
        for _ in range(self.rounds):
            moved_C = _moved(points_C, rates, intervals_s)
            if moved_C[:, 2].min() < _LEAST_DEPTH_M:
                return None
            x, y = moved_C[:, 0] / moved_C[:, 2], moved_C[:, 1] / moved_C[:, 2]
            misfit = np.stack((seen[:, 0] - x, seen[:, 1] - y), axis=1)
            distance = np.hypot(misfit[:, 0], misfit[:, 1])
            noise = max(least, float(np.median(distance)) / _MEDIAN_OF_RAYLEIGH)
            weight = np.clip(1.0 - (distance / (_TUKEY_SIGMAS * noise)) ** 2, 0.0, None) ** 2
            flow = _flow(x, y, 1.0 / moved_C[:, 2], intervals_s)
            weighted = flow * weight[:, None, None]
            try:
                inverse = np.linalg.inv(np.einsum("nri,nrj->ij", weighted, flow))
            except np.linalg.LinAlgError:
                return None
            pull = np.einsum("ij,nrj->inr", inverse, weighted)
            rates = rates + np.einsum("inr,nr->i", pull, misfit)
        inliers = int(np.count_nonzero(distance < _INLIER_SIGMAS * noise))
        if inliers < self.least_tracks or noise > most:
            return None
        return _Solution(rates, noise**2 * inverse, pull, flow, weight / weight.sum(), inliers)


class _Solution(NamedTuple):
    """(ω, v) with covariance, the pull (6, N, 2) of the points on it, their flow (N, 2, 6) and share (N,)."""

    rates: FloatArray
    covariance: FloatArray
    pull: FloatArray
    flow: FloatArray
    weight: FloatArray
    inliers: int


def _corrected(before: _Step, step: _Step, after: _Step) -> EgoMotion:
    """Return the motion of `step` without what the rolling shutter adds by (2)."""
    change = (after.rates - before.rates) / (after.middle_s - before.middle_s)
    rates = step.rates - step.row_lag_s @ change
    return EgoMotion(step.t_before_ns, step.t_after_ns, rates[:3], rates[3:], step.covariance, step.tracks)


class _Eye:
    """One lens, its rays turned into C."""

    def __init__(self, lens: Lens, R_C_raw: FloatArray) -> None:
        self._K = intrinsics(lens)
        self._distortion = np.array(lens.distortion)
        self._R_C_raw = R_C_raw
        self._turn_back = cv2.Rodrigues(R_C_raw.T)[0]
        self.f_px = float(self._K[0, 0])

    def rays_C(self, points_px: Float32Array) -> FloatArray:
        """Return the rays (N, 3), z = 1, in C of pixels (N, 2)."""
        flat = cv2.undistortPoints(points_px[:, None], self._K, self._distortion, R=self._R_C_raw).reshape(-1, 2)
        return np.column_stack((flat.astype(np.float64), np.ones(len(flat))))

    def pixels(self, points_C: FloatArray) -> Float32Array:
        """Return the pixels (N, 2) that show points (N, 3) in C."""
        flat = cv2.projectPoints(points_C[:, None], self._turn_back, _ORIGIN, self._K, self._distortion)[0]
        return flat.reshape(-1, 2).astype(np.float32)


def _reduced(lens: Lens, divisor: int) -> Lens:
    """Return the lens of a picture reduced by a whole `divisor` with an area average."""
    return msgspec.structs.replace(
        lens,
        width_px=lens.width_px // divisor,
        height_px=lens.height_px // divisor,
        fx_px=lens.fx_px / divisor,
        fy_px=lens.fy_px / divisor,
        cx_px=(lens.cx_px + 0.5) / divisor - 0.5,
        cy_px=(lens.cy_px + 0.5) / divisor - 0.5,
    )


_ORIGIN = np.zeros(3)
_X_AXIS = np.array([1.0, 0.0, 0.0])
_COARSE_SEARCH = DisparityRange(0, 32)
"""Of the coarse picture: from infinity to what is nearer than any ground."""
_LEAST_DISPARITY_PX = 1.5
"""Of the coarse picture: with less, depth is hardly known at all."""
_LEAST_DEPTH_M = 0.1
"""In front of the camera: a point nearer is no solution."""
_MEDIAN_OF_RAYLEIGH = 1.1774
"""Over the deviation of either coordinate."""
_TUKEY_SIGMAS = 4.685
"""From which on a point has no weight: 95 % efficiency with normal noise."""
_INLIER_SIGMAS = 3.0
"""Within which a point counts as agreeing: of normal noise, 99 % of the points."""
_WINDOW_PX = (11, 11)
"""Followed about a corner: more would reach over edges in depth."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.03)
"""Steps at most, and in px the step that ends the search: no longer than `least_noise_px`."""


def _corners(image: GreyImage, most: int, quality: float, spacing_px: float) -> Float32Array:
    """Return the pixels (N, 2) of the best corners."""
    found = cv2.goodFeaturesToTrack(image, most, quality, spacing_px)
    # OpenCV returns None for none, against its own type hints
    return np.empty((0, 2), np.float32) if found is None else found.reshape(-1, 2).astype(np.float32)


def _tracked(
    before: GreyImage, after: GreyImage, points_px: Float32Array, guess_px: Float32Array, levels: int
) -> tuple[Float32Array, BoolArray]:
    """Return where `points_px` (N, 2) of one picture are in another, and which of them were found there."""
    tracked_px, status, _ = cv2.calcOpticalFlowPyrLK(
        before,
        after,
        points_px[:, None],
        guess_px[:, None].copy(),
        winSize=_WINDOW_PX,
        maxLevel=levels,
        criteria=_STOP,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return tracked_px.reshape(-1, 2).astype(np.float32), status.ravel() == 1


def _moved(points_C: FloatArray, rates: FloatArray, intervals_s: FloatArray) -> FloatArray:
    """Return X' of (1) for points (N, 3), each after its own interval (N,); `rates` (6,) are ω and v."""
    rate_radps = float(np.linalg.norm(rates[:3]))
    left_C = points_C - np.outer(intervals_s, rates[3:])
    if rate_radps == 0.0:
        return left_C
    axis_cross = skew(rates[:3] / rate_radps)
    angles_rad = -rate_radps * intervals_s[:, None]
    across_C = left_C @ axis_cross.T
    turned: FloatArray = left_C + np.sin(angles_rad) * across_C + (1.0 - np.cos(angles_rad)) * (across_C @ axis_cross.T)
    return turned


def _flow(x: FloatArray, y: FloatArray, inverse_depth_pm: FloatArray, intervals_s: FloatArray) -> FloatArray:
    """Return ∂(x, y)/∂(ω, v) of (1), (N, 2, 6)."""
    zero = np.zeros_like(x)
    along_x = (x * y, -1.0 - x * x, y, -inverse_depth_pm, zero, x * inverse_depth_pm)
    along_y = (1.0 + y * y, -x * y, -x, zero, -inverse_depth_pm, y * inverse_depth_pm)
    return intervals_s[:, None, None] * np.stack((np.stack(along_x, axis=1), np.stack(along_y, axis=1)), axis=1)
