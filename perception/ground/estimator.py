"""A frame and the attitude at its mid-exposure to the published estimate of the ground ahead."""

import math
from functools import partial

import msgspec
import numpy as np

from messages import Frame, GroundPlane, Reason, Status, StereoFrame, UnitCalibration, Vec3, upper_triangle
from messages.arrays import FloatArray
from perception import so3
from perception.depth.focal_lengths import UNWATCHED, FocalDifference
from perception.depth.repeats import Repeats
from perception.ground.aim import Aim, aimed, view_of
from perception.ground.first_search import FirstSearch
from perception.ground.foothold import FootholdSettings
from perception.ground.known_height import HeightDifference, KnownHeight
from perception.ground.meter import GroundMeasurement, GroundMeter
from perception.ground.plane import Plane
from perception.ground.repetition import RepetitionWatch, as_steep
from perception.ground.surface_change import (
    SurfaceChange,
    apart_cov,
    beside_bend_cov,
    is_other_surface,
    plane_of,
    plane_under,
    region_on,
)
from perception.ground.tracking import PlaneTracker, TrackingSettings
from perception.ground.view_check import ViewCheck
from perception.heading import heading
from perception.terrain.path_ahead import NO_PATH, PathAhead
from perception.terrain.surfaces import PathSurfaces, Surface


class GroundEstimator:
    """Measures each frame, follows the plane over time and states what the estimate is worth."""

    def __init__(self, calibration: UnitCalibration, foothold: FootholdSettings) -> None:
        self._residual = calibration.residual
        self._calibration_id = calibration.id
        self._foothold = foothold
        self._region = foothold.region
        self._change = SurfaceChange()
        self._lasting_cov = np.zeros((3, 3))
        self._meter = GroundMeter(calibration.camera, calibration.residual, foothold.matching_width_px)
        self._tracker = PlaneTracker(TrackingSettings())
        self._repetition = RepetitionWatch()
        self._view = ViewCheck(self._meter)
        wearer = None if calibration.wearer is msgspec.UNSET else calibration.wearer
        self._search = FirstSearch(wearer)
        self._known_height = KnownHeight(wearer)
        self._tracks = False
        self._swap_watch = _SwapWatch()
        self.camera = self._meter.camera
        self.R_BC: FloatArray = np.array(calibration.X_BE.R) @ self._meter.camera.R_EC
        """Takes vectors of the rectified camera to B, (3, 3)."""
        self._p_BC_m = np.array(calibration.X_BE.p_m)

    @property
    def height_difference(self) -> HeightDifference:
        """Return how the ground's height differs from the wearer's, where the calibration has that."""
        return self._known_height.difference

    def is_ambiguous(self, t_ns: int) -> bool:
        """Return whether the floor repeats itself so that, but for the track, planes a tile apart match as well."""
        return self._repetition.is_ambiguous(t_ns)

    def makes_ambiguous(self, frame: Frame, R_WB: FloatArray, ground: GroundPlane, path: PathSurfaces) -> bool:
        """Return whether a `path` that `frame` shows may lie a tile off where `ground` does not, if that is valid."""
        R_WC = R_WB @ self.R_BC
        R_WH = heading(R_WC)
        if ground.status is not Status.VALID or R_WH is None:
            return False

        def ask(surface: Surface) -> Repeats:
            region, plane = region_on(surface, path.yaw_rad, self._region), plane_of(surface, path.yaw_rad)
            return self._meter.find_repeats(frame.images, R_WH.T @ R_WC, region, plane)

        alike = as_steep(path.surfaces, math.tan(ground.slope_sagittal_rad))
        return self._repetition.makes_ambiguous(ground.t_exposure_ns, ground.height_m, alike, ask)

    def set_foothold(self, foothold: FootholdSettings) -> None:
        """Measure another region from the next frame on."""
        self._foothold = foothold

    def estimate(
        self,
        frame: Frame,
        R_WB: FloatArray,
        w_WB_B_radps: Vec3,
        rotation_cov_W_rad2: FloatArray,
        *,
        height_rate_mps: float = 0.0,
        v_W_mps: Vec3 | None = None,
        distance_scale: float = 0.0,
        focal_difference: FocalDifference = UNWATCHED,
        may_begin: bool = True,
        reduced: bool = False,
        place_m: tuple[float, float] | None = None,
        path: PathAhead = NO_PATH,
    ) -> GroundPlane:
        """Return the ground in H of `frame`, given the attitude, its covariance and the rate at mid-exposure.

        `height_rate_mps` is how fast the camera moves away from the ground: a walker's bob, not the climb of a ramp.
        `v_W_mps` is the velocity of the IMU; without it nobody asks whether the view is deformed.
        `distance_scale` is by what share the camera's distances are too long, `focal_difference` what is known of its
        eyes' focal lengths beyond the calibration. A plane that contradicts the track begins no new one unless it
        `may_begin`: while the camera's motion cannot be followed, what matches may be chance, and is UNCONFIRMED. Nor
        does one confirm it beside which much else is seen, or on which the two eyes are not alike.
        With `reduced` only the middle half of the region's width is matched.
        `place_m`, x and y of H, is where the foot will land; the region is about it, on the surface that `path` shows
        there. Without it the settings' own region is measured.
        """
        if tuple(image.shape[::-1] for image in frame.images) != tuple(self._meter.camera.image_sizes_px):
            return self._invalid(frame, Reason.WRONG_SIZE)
        R_WC = R_WB @ self.R_BC
        R_WH = heading(R_WC)
        if R_WH is None:
            return self._invalid(frame, Reason.FOOTHOLD_OUT_OF_VIEW)
        t_ns = frame.header.t_exposure_ns
        R_HC, attitude_cov_W = R_WH.T @ R_WC, _of_slopes(rotation_cov_W_rad2)
        v_C_W = None if v_W_mps is None else v_W_mps + R_WB @ so3.skew(np.array(w_WB_B_radps)) @ self._p_BC_m
        aim = self._aim(t_ns, R_HC, R_WH, attitude_cov_W, place_m, path, v_C_W)
        bend_cov = beside_bend_cov(aim.region, path)
        if aim.passed and v_C_W is not None:
            return self._carried(frame, R_HC, R_WH, rotation_cov_W_rad2, w_WB_B_radps, v_C_W, distance_scale, bend_cov)
        if aim.reason is not Reason.NONE:
            if v_C_W is not None:
                self._tracker.carry(t_ns, R_WH, v_C_W, attitude_cov_W)
            return self._invalid(frame, aim.reason)
        expected = self._tracker.predicted(t_ns, R_WH)
        w_WC_C_radps = self.R_BC.T @ np.array(w_WB_B_radps)
        region = self._region.narrowed() if reduced else self._region
        searched = self._search.begin(region) if expected is None else self._search.skip(region)

        def measure(near: Plane | None, margin_m: float | None = None, *, swapped: bool = False) -> GroundMeasurement:
            images, band = (frame.images[::-1], searched.likely) if swapped else (frame.images, searched.band)
            return self._meter.measure(
                images, R_HC, w_WC_C_radps, height_rate_mps, band, near, margin_m, focal_difference, rough=path.rough
            )

        measured = measure(expected, self._repetition.margin_m(t_ns, expected))
        if searched.unlikely and measured.fit is not None and not self._meter.is_even(measured.fit):
            measured = GroundMeasurement(Reason.NOT_PLANAR, measured.matched_share)
        begins = may_begin
        if measured.fit is not None:
            self._swap_watch.clear()
            ask = partial(self._meter.find_repeats, frame.images, R_HC, region)
            measured, tells = self._repetition.resolved(
                t_ns, measured, measured.fit, expected, searched.bounds, ask, measure
            )
            begins = may_begin and tells
        if measured.fit is None:
            self._tracker.miss()
        reason = measured.reason if expected is not None else self._search.ended(measured.reason)
        if measured.fit is None and self._repetition.repeats(t_ns):
            return self._invalid(frame, reason, measured.matched_share)
        if measured.fit is None:
            suspected = isinstance(frame, StereoFrame) and self._swap_watch.suspects(reason)
            swapped = suspected and measure(None, swapped=True).fit is not None
            return self._invalid(frame, self._swap_watch.verdict(reason, swapped), measured.matched_share)
        view = self._view.found
        if v_C_W is not None and not region.bounded:
            view = self._view.check(
                t_ns, frame.images, R_HC, region, measured, w_WC_C_radps, R_WC.T @ v_C_W, settled=self._tracks
            )
        if view.contradicts:
            self._tracker.miss()
            return self._invalid(frame, Reason.VIEW_DEFORMED, measured.matched_share)
        alike = self._view.eyes_are_alike or self._repetition.repeats(t_ns)  # tiles a row too far match something else
        tracked = self._tracker.updated(
            t_ns,
            measured.fit,
            measured.matched_share,
            R_WH,
            attitude_cov_W,
            may_begin=begins and not view.doubtful,
            even=alike and (path.rough or self._meter.is_even(measured.fit)),
            v_W_mps=v_C_W,
        )
        if tracked is None and self._tracks:
            self._view.begin_anew()
        self._tracks = tracked is not None
        if tracked is None:
            self._known_height.begin_anew()
            if expected is None and may_begin:
                self._search.not_followed()
            reason = Reason.NOT_PLANAR if may_begin else Reason.UNCONFIRMED
            return self._invalid(frame, reason, measured.matched_share)
        plane, plane_cov = tracked
        plane_cov = plane_cov + bend_cov + apart_cov(plane, plane_cov, region, path)
        self._lasting_cov = measured.lasting_cov + self._view.covariance(plane, R_HC)
        ground = self._valid(frame, plane, plane_cov, R_HC, R_WH, rotation_cov_W_rad2, w_WB_B_radps, distance_scale)
        if v_W_mps is not None:
            self._known_height.add(t_ns, ground.height_m, math.hypot(*v_W_mps[:2]), region)
        return msgspec.structs.replace(
            ground,
            matched_share=measured.matched_share,
            inlier_share=measured.fit.inlier_share,
            disparity_noise_px=measured.fit.noise_px,
        )

    def _carried(
        self,
        frame: Frame,
        R_HC: FloatArray,
        R_WH: FloatArray,
        rotation_cov_W: FloatArray,
        w_WB_B_radps: Vec3,
        v_C_W_mps: FloatArray,
        distance_scale: float,
        bend_cov: FloatArray,
    ) -> GroundPlane:
        """Return the ground under a foothold that the picture does not show any more: as it was last seen."""
        t_ns = frame.header.t_exposure_ns
        carried = self._tracker.carry(t_ns, R_WH, v_C_W_mps, _of_slopes(rotation_cov_W))
        if carried is None:
            return self._invalid(frame, Reason.FOOTHOLD_OUT_OF_VIEW)
        plane, plane_cov = carried
        ground = self._valid(
            frame, plane, plane_cov + bend_cov, R_HC, R_WH, rotation_cov_W, w_WB_B_radps, distance_scale
        )
        return msgspec.structs.replace(ground, matched_share=0.0)

    def _valid(
        self,
        frame: Frame,
        plane: Plane,
        plane_cov: FloatArray,
        R_HC: FloatArray,
        R_WH: FloatArray,
        rotation_cov_W: FloatArray,
        w_WB_B_radps: Vec3,
        distance_scale: float,
    ) -> GroundPlane:
        """Return the estimate that tells `plane`, of whose (a, b, h) the frames leave the covariance `plane_cov`."""
        cov = _slope_cov(plane, plane_cov + self._lasting_cov + self._height_cov(plane, R_HC))
        cov[:2, :2] += _of_slopes(R_WH.T @ rotation_cov_W @ R_WH) + self._mounting_cov(w_WB_B_radps)
        return GroundPlane(
            t_exposure_ns=frame.header.t_exposure_ns,
            frame_seq=frame.header.seq,
            status=Status.VALID,
            reason=Reason.NONE,
            slope_sagittal_rad=float(np.arctan(plane.gradient[0])),
            slope_frontal_rad=float(np.arctan(plane.gradient[1])),
            height_m=plane.height_m / (1.0 + distance_scale),
            covariance=upper_triangle(cov),
            ahead_m=self._region.ahead_m,
            matched_share=math.nan,
            inlier_share=math.nan,
            disparity_noise_px=math.nan,
            calibration_id=self._calibration_id,
            left_m=self._region.left_m,
        )

    def _aim(
        self,
        t_ns: int,
        R_HC: FloatArray,
        R_WH: FloatArray,
        attitude_cov_W: FloatArray,
        place_m: tuple[float, float] | None,
        path: PathAhead,
        v_C_W_mps: FloatArray | None,
    ) -> Aim:
        """Choose the region of this frame; on another surface the track goes on from what the path shows of it, unless
        that may lie a tile off and no picture will tell."""
        if v_C_W_mps is not None:
            self._change.move(t_ns, (R_WH.T @ v_C_W_mps)[:2])
        expected = self._tracker.predicted(t_ns, R_WH)
        height_m = self._foothold.nominal_height_m if expected is None else expected.height_m
        aim = aimed(self._foothold, place_m, path, view_of(self._meter.camera, R_HC, height_m))
        self._region = aim.region
        if aim.reason is not Reason.NONE and not aim.passed:
            return aim
        begins = aim.region.bounded or aim.passed
        if expected is not None:
            begins = is_other_surface(expected, aim.region, path)
        if self._change.has_come(t_ns, aim.region, path) or begins:
            under = plane_under(aim.region, path)
            if under is None or (aim.passed and self._repetition.repeats(t_ns)):
                self._tracker.forget()
            else:
                self._tracker.begin(t_ns, *under, R_WH, attitude_cov_W)
                self._repetition.check_next()
            self._view.begin_anew()
            self._known_height.begin_anew()
        return aim

    def _invalid(self, frame: Frame, reason: Reason, matched_share: float = float("nan")) -> GroundPlane:
        """Return the estimate that says only why `frame` gives none."""
        return GroundPlane.invalid(
            t_exposure_ns=frame.header.t_exposure_ns,
            frame_seq=frame.header.seq,
            reason=reason,
            ahead_m=self._region.ahead_m,
            calibration_id=self._calibration_id,
            matched_share=matched_share,
            left_m=self._region.left_m,
        )

    def _height_cov(self, plane: Plane, R_HC: FloatArray) -> FloatArray:
        """Return the covariance (3, 3) of (a, b, h) by what the height differs from the wearer's.

        What neither shoes nor posture explain may be a common offset of the disparities, which turns the plane as well.
        """
        found = self._known_height.difference
        cov = np.zeros((3, 3))
        if found.contradicts:
            cov = self._meter.offset_cov(plane, R_HC, np.array([[0.0, 0.0, 1.0]]))
            cov *= found.variance_m2 / cov[2, 2]
        else:
            cov[2, 2] = found.variance_m2
        return cov

    def _mounting_cov(self, w_B_radps: Vec3) -> FloatArray:
        """Return the covariance (2, 2) that mounting and frame time add to the slopes."""
        late_rad2 = sum(w * w for w in w_B_radps) * self._residual.time_s**2
        return np.eye(2) * (self._residual.camera_to_imu_rad**2 + late_rad2)


def _of_slopes(rotation_cov: FloatArray) -> FloatArray:
    """Return the covariance (2, 2) that a small rotation of covariance (3, 3) gives the slopes, in the same frame."""
    # a rotation δ turns the slopes by (−δ_y, δ_x) to first order
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    turned: FloatArray = turn @ rotation_cov @ turn.T
    return turned


def _slope_cov(plane: Plane, cov_abh: FloatArray) -> FloatArray:
    """Return the covariance (3, 3) of (slope_sagittal, slope_frontal, height) from that of (a, b, h)."""
    slope_per_gradient = np.diag([1.0 / (1.0 + plane.gradient[0] ** 2), 1.0 / (1.0 + plane.gradient[1] ** 2), 1.0])
    cov: FloatArray = slope_per_gradient @ cov_abh @ slope_per_gradient
    return cov


class _SwapWatch:
    """Suspects exchanged eyes after a run of frames that did not match, and then tries one exchanged pair a run."""

    run = 10

    def __init__(self) -> None:
        self._unmatched = 0
        self._swapped = False

    def suspects(self, reason: Reason) -> bool:
        self._unmatched += reason in (Reason.LOW_TEXTURE, Reason.NOT_PLANAR, Reason.TOO_STEEP)
        return self._unmatched > 0 and self._unmatched % self.run == 0

    def verdict(self, reason: Reason, swapped: bool) -> Reason:
        self._swapped = self._swapped or swapped
        return Reason.EYES_SWAPPED if self._swapped else reason

    def clear(self) -> None:
        self._unmatched, self._swapped = 0, False
