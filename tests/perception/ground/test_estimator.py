"""The ground of rendered frames: the foothold's slope and height, and the uncertainty that goes with them."""

import math
from collections.abc import Callable
from dataclasses import replace
from unittest.mock import MagicMock

import cv2
import msgspec
import numpy as np
import pytest

from messages import Calibration, GroundPlane, GroundTruth, Reason, Status, StereoFrame, Vec3, WearerHeight
from perception.depth.deformation import SOUND
from perception.depth.disparity import OutOfRangeError
from perception.depth.matcher import DisparityRange, SemiGlobalMatcher
from perception.depth.rectify import Rectifier, Window
from perception.depth.stereo_camera import view_of
from perception.ground.aim import Aim
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from perception.ground.plane import Plane
from perception.ground.repetition import RepetitionWatch
from perception.ground.view_check import ViewCheck
from perception.terrain.edges import Edge
from perception.terrain.path_ahead import PathAhead
from perception.terrain.surfaces import Surface
from sim_rig.walk.relief import Relief
from sim_rig.walk.scenario import Pace, over_level, scenario
from sim_rig.walk.world import World
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
CONTRADICTED = SOUND._replace(contradicts=True)
AS_SHIPPED = FootholdSettings()


def seen(
    name: str,
    seed: int,
    first: int,
    count: int,
    spoilt: Callable[[StereoFrame], StereoFrame] = lambda frame: frame,
    foothold: FootholdSettings = AS_SHIPPED,
) -> tuple[list[tuple[GroundPlane, GroundTruth]], Calibration]:
    """Return estimates with the true attitude and a perfect calibration, of frames each `spoilt`, and their truth."""
    wearer = SimulatedWearer(seed, scenario(name), START_NS, perfect_calibration=True)
    estimator = GroundEstimator(wearer.calibration, foothold)
    pairs = []
    for frame, truth in wearer.frames(count, first=first):
        motion = wearer.gait.at(np.array([frame.header.t_exposure_ns]))
        w = tuple(motion.w_WB_B_radps[0].tolist())
        vertical_swing_mps = float(motion.v_WB_mps[0] @ [-np.tan(truth.slope_sagittal_rad), 0.0, 1.0])
        estimate = estimator.estimate(
            spoilt(frame), motion.R_WB[0], w, np.zeros((3, 3)), height_rate_mps=vertical_swing_mps
        )
        pairs.append((estimate, truth))
    return pairs[1:], wearer.calibration  # the first waits for its confirmation


def confirmed(
    estimator: GroundEstimator,
    frame: StereoFrame,
    R_WB: np.ndarray,
    cov: np.ndarray,
    w_B_radps: Vec3 = (0.0, 0.0, 0.0),
) -> GroundPlane:
    """Return what a fresh estimator says of a frame that comes twice: the first plane waits for its confirmation."""
    estimator.estimate(frame, R_WB, w_B_radps, cov)
    return estimator.estimate(frame, R_WB, w_B_radps, cov)


def errors(pairs: list[tuple[GroundPlane, GroundTruth]]) -> np.ndarray:
    return np.array(
        [
            (
                ground.slope_sagittal_rad - truth.slope_sagittal_rad,
                ground.slope_frontal_rad - truth.slope_frontal_rad,
                ground.height_m - truth.height_m,
            )
            for ground, truth in pairs
            if not truth.transition
        ]
    )


@pytest.mark.parametrize(("name", "seed", "first"), [("standing", 11, 20), ("level", 12, 80), ("ramps", 13, 150)])
def test_slope_and_height_agree_with_the_truth_within_what_is_stated(name: str, seed: int, first: int) -> None:
    pairs, _ = seen(name, seed, first, 30)
    assert all(ground.status is Status.VALID for ground, _ in pairs)
    rms = np.sqrt((errors(pairs) ** 2).mean(axis=0))
    assert np.degrees(rms[0]) < 0.3
    assert np.degrees(rms[1]) < 0.2
    assert rms[2] < 0.005
    stated = np.array([ground.covariance for ground, truth in pairs if not truth.transition])[:, [0, 3, 5]]
    within = np.abs(errors(pairs)) <= 1.96 * np.sqrt(stated)
    assert within.mean() > 0.85


def test_at_full_width_the_plane_is_steadier() -> None:
    spread = []
    for width_px in (640, 1280):
        pairs, _ = seen("standing", 11, 20, 12, foothold=FootholdSettings(matching_width_px=width_px))
        assert all(ground.status is Status.VALID for ground, _ in pairs)
        spread.append(errors(pairs).std(axis=0))
    assert (spread[1] < 0.8 * spread[0]).all()


@pytest.mark.parametrize("nominal_height_m", [0.5, 1.4])
def test_a_wrong_nominal_height_costs_some_frames_and_no_plane(nominal_height_m: float) -> None:
    wearer = SimulatedWearer(11, scenario("standing"), START_NS, perfect_calibration=True)
    estimator = GroundEstimator(wearer.calibration, FootholdSettings(nominal_height_m=nominal_height_m))
    found = []
    for frame, truth in wearer.frames(7, first=20):
        R_WB = wearer.gait.at(np.array([frame.header.t_exposure_ns])).R_WB[0]
        found.append((estimator.estimate(frame, R_WB, (0.0, 0.0, 0.0), np.zeros((3, 3))), truth))
    assert found[0][0].status is Status.INVALID
    ground, truth = found[-1]
    assert ground.status is Status.VALID
    assert ground.height_m == pytest.approx(truth.height_m, abs=0.01)


@pytest.mark.parametrize(
    ("nominal_height_m", "rough", "found"), [(0.95, True, True), (0.95, False, False), (0.5, True, False)]
)
def test_bumps_are_ground_on_a_rough_path_at_the_likely_height_alone(
    nominal_height_m: float, rough: bool, found: bool
) -> None:
    bare = over_level(Pace(), "bumps", "nothing on it")
    walk = replace(bare, world=World(bare.world.lap, Relief.of_rms(0.03, 0.15, 7)))
    wearer = SimulatedWearer(11, walk, START_NS, perfect_calibration=True)
    estimator = GroundEstimator(wearer.calibration, FootholdSettings(nominal_height_m=nominal_height_m))
    valid = []
    for frame, _ in wearer.frames(8, first=20):
        R_WB = wearer.gait.at(np.array([frame.header.t_exposure_ns])).R_WB[0]
        path = PathAhead(rough=rough)
        ground = estimator.estimate(frame, R_WB, (0.0, 0.0, 0.0), np.zeros((3, 3)), path=path)
        valid.append(ground.status is Status.VALID)
    assert any(valid) is found


def test_bumps_on_a_path_that_is_not_known_to_be_rough_join_no_track() -> None:
    bare = over_level(Pace(), "bumps", "nothing on it")
    walk = replace(bare, world=World(bare.world.lap, Relief.of_rms(0.03, 0.15, 7)))
    wearer = SimulatedWearer(11, walk, START_NS, perfect_calibration=True)
    estimator, valid = GroundEstimator(wearer.calibration, FootholdSettings()), list[bool]()
    for k, (frame, _) in enumerate(wearer.frames(6, first=20)):
        R_WB = wearer.gait.at(np.array([frame.header.t_exposure_ns])).R_WB[0]
        path = PathAhead(rough=k < 3)
        ground = estimator.estimate(frame, R_WB, (0.0, 0.0, 0.0), np.zeros((3, 3)), path=path)
        valid.append(ground.status is Status.VALID)
    assert valid == [False, True, True, False, False, False]


@pytest.mark.parametrize(("off_m", "contradicts"), [(-0.03, False), (0.2, True)])
def test_what_differs_from_the_wearers_height_widens_the_height_and_beyond_all_shoes_the_slope(
    off_m: float, contradicts: bool
) -> None:
    wearer = SimulatedWearer(12, scenario("level"), START_NS, perfect_calibration=True)
    frame, truth = next(iter(wearer.frames(1, first=20)))
    R_WB = wearer.gait.at(np.array([frame.header.t_exposure_ns])).R_WB[0]
    known = WearerHeight(camera_height_m=truth.height_m - off_m, std_m=0.005)

    def after_a_walk(calibration: Calibration) -> tuple[GroundEstimator, GroundPlane]:
        """One picture for six seconds of a slow walk."""
        estimator = GroundEstimator(calibration, FootholdSettings())
        for k, t_s in enumerate((0.0, 0.05, *np.arange(0.25, 6.5, 0.2))):
            t_ns = frame.header.t_exposure_ns + round(1e9 * t_s)
            header = msgspec.structs.replace(frame.header, seq=k, t_exposure_ns=t_ns)
            later = msgspec.structs.replace(frame, header=header)
            ground = estimator.estimate(later, R_WB, (0.0, 0.0, 0.0), np.zeros((3, 3)), v_W_mps=(0.45, 0.0, 0.0))
        return estimator, ground

    _, alone = after_a_walk(wearer.calibration)
    estimator, ground = after_a_walk(msgspec.structs.replace(wearer.calibration, wearer=known))
    assert estimator.height_difference.contradicts is contradicts
    assert estimator.height_difference.off_m == pytest.approx(off_m, abs=0.01)
    assert np.sqrt(ground.covariance[5] - alone.covariance[5]) == pytest.approx(abs(off_m), abs=0.01)
    assert (ground.covariance[0] > 2.0 * alone.covariance[0]) is contradicts
    assert ground.slope_sagittal_rad == pytest.approx(alone.slope_sagittal_rad, abs=1e-9)
    assert ground.height_m == pytest.approx(alone.height_m, abs=1e-9)


@pytest.mark.long
def test_rolling_shutter_is_corrected() -> None:
    wearer = SimulatedWearer(14, scenario("level"), START_NS, perfect_calibration=True)
    with_rate: list[tuple[GroundPlane, GroundTruth]] = []
    without: list[tuple[GroundPlane, GroundTruth]] = []
    for frame, truth in wearer.frames(40, first=80):
        motion = wearer.gait.at(np.array([frame.header.t_exposure_ns]))
        w = tuple(motion.w_WB_B_radps[0].tolist())
        for rate, found in ((w, with_rate), ((0.0, 0.0, 0.0), without)):
            fresh = GroundEstimator(wearer.calibration, FootholdSettings())
            found.append((confirmed(fresh, frame, motion.R_WB[0], np.zeros((3, 3)), rate), truth))
    assert np.abs(errors(with_rate)[:, 0]).mean() < 0.8 * np.abs(errors(without)[:, 0]).mean()


@pytest.mark.long
def test_at_an_edge_the_stated_uncertainty_grows() -> None:
    pairs, _ = seen("mixed", 15, 90, 90)
    assert {ground.reason for ground, truth in pairs if not truth.transition} == {Reason.NONE}
    spread = {
        edge: np.nanmedian([g.covariance[0] + g.covariance[5] for g, t in pairs if t.transition is edge])
        for edge in (True, False)
    }
    assert spread[True] > 3.0 * spread[False]


def test_a_region_outside_the_picture_is_out_of_view() -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    far = GroundEstimator(wearer.calibration, FootholdSettings(ahead_m=0.2))
    frame, _ = next(iter(wearer.frames(1)))
    motion = wearer.gait.at(np.array([frame.header.t_exposure_ns]))
    ground = far.estimate(frame, motion.R_WB[0], (0.0, 0.0, 0.0), np.zeros((3, 3)))
    assert (ground.status, ground.reason) == (Status.INVALID, Reason.FOOTHOLD_OUT_OF_VIEW)
    assert np.isnan(ground.height_m)


def test_a_camera_that_looks_straight_down_has_no_heading() -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    frame, _ = next(iter(wearer.frames(1)))
    R_BC = np.array(wearer.calibration.X_BL.R) @ Rectifier(wearer.calibration.stereo, 2).R_LC
    down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]) @ R_BC.T
    estimator = GroundEstimator(wearer.calibration, FootholdSettings())
    assert estimator.estimate(frame, down, (0.0, 0.0, 0.0), np.zeros((3, 3))).reason is Reason.FOOTHOLD_OUT_OF_VIEW


def test_ground_nearer_than_the_search_can_match_is_out_of_range() -> None:
    rectifier = Rectifier(SimulatedWearer(16, scenario("standing"), START_NS).calibration.stereo, 1)
    s = np.sqrt(0.5)
    R_HC = np.array([[0, -s, s], [-1, 0, 0], [0, -s, -s]])
    near = FootholdSettings(ahead_m=0.3, half_length_m=0.1).region
    with pytest.raises(OutOfRangeError):
        view_of(near.footprint(Plane((0.0, 0.0), 0.35), 0.2) @ R_HC, rectifier)


def test_an_uncertain_attitude_makes_the_slope_about_its_axis_uncertain() -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    frame, _ = next(iter(wearer.frames(1)))
    R_WB = wearer.gait.at(np.array([frame.header.t_exposure_ns])).R_WB[0]

    def slope_variances(pitch_rad: float, roll_rad: float) -> np.ndarray:
        # the wearer faces x of W: a small rotation about W's y pitches, one about its x rolls
        cov = np.diag([roll_rad**2, pitch_rad**2, 0.3])
        ground = confirmed(GroundEstimator(wearer.calibration, FootholdSettings()), frame, R_WB, cov)
        return np.array([ground.covariance[0], ground.covariance[3]])

    none, pitched, rolled = slope_variances(0.0, 0.0), slope_variances(0.02, 0.0), slope_variances(0.0, 0.03)
    assert pitched - none == pytest.approx([0.02**2, 0.0], abs=4e-6)
    assert rolled - none == pytest.approx([0.0, 0.03**2], abs=9e-6)


@pytest.mark.parametrize(
    ("spoilt", "reason"),
    [
        (lambda image: image // 100, Reason.OVER_EXPOSED),
        (lambda image: np.maximum(image, 255), Reason.OVER_EXPOSED),
        (lambda image: np.full_like(image, 120) + image % 3, Reason.LOW_TEXTURE),
    ],
    ids=["a hundredth of the light", "white", "only noise"],
)
def test_what_shows_too_little_is_not_matched(spoilt: Callable[[np.ndarray], np.ndarray], reason: Reason) -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    frame, _ = next(iter(wearer.frames(1)))
    R_WB = wearer.gait.at(np.array([frame.header.t_exposure_ns])).R_WB[0]
    estimator = GroundEstimator(wearer.calibration, FootholdSettings())
    dark = msgspec.structs.replace(frame, left=spoilt(frame.left), right=spoilt(frame.right))
    assert confirmed(estimator, dark, R_WB, np.zeros((3, 3))).reason is reason
    assert confirmed(estimator, frame, R_WB, np.zeros((3, 3))).reason is Reason.NONE


def test_where_the_picture_is_white_nothing_is_matched() -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    frame, _ = next(iter(wearer.frames(1)))
    rectifier = Rectifier(wearer.calibration.stereo, 2)
    window, search = Window(200, 260, 200, 400), DisparityRange.covering(20.0, 60.0)
    left = frame.left.copy()
    left[:, 640:] = 255
    matched = np.isfinite(SemiGlobalMatcher(rectifier).match(left, frame.right, window, search))
    assert matched[:, :100].mean() > 0.9
    assert matched[:, 130:].mean() == 0.0


def test_through_a_wet_lens_stripes_that_match_half_a_period_off_are_no_ground() -> None:
    def wet(frame: StereoFrame) -> StereoFrame:
        left = cv2.blur(frame.left, (25, 25)).astype(np.uint8)
        return msgspec.structs.replace(frame, left=left) if frame.header.seq >= 424 else frame

    pairs, _ = seen("ramps", 33, 418, 24, wet)
    assert [ground.status for ground, _ in pairs[:5]] == [Status.VALID] * 5
    assert [ground.status for ground, _ in pairs[5:]] == [Status.INVALID] * 18


def test_on_tiles_all_alike_no_valid_ground_is_a_tile_off() -> None:
    standing, _ = seen("mosaic-2.5cm", 1, 20, 4)
    walking, _ = seen("mosaic-2.5cm", 1, 76, 14)
    assert [ground.reason for ground, _ in standing] == [Reason.LOW_TEXTURE] * 3  # the rows lie along the tiles
    heights_m = [(ground.height_m, truth.height_m) for ground, truth in walking if ground.status is Status.VALID]
    assert len(heights_m) >= 8
    assert max(abs(height_m - true_m) for height_m, true_m in heights_m) < 0.01  # a tile off: 0.15 m and more


def test_a_plane_is_not_confirmed_past_two_frames_whose_view_is_deformed(monkeypatch: pytest.MonkeyPatch) -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    estimator, told = GroundEstimator(wearer.calibration, FootholdSettings()), list[Reason]()
    sound = ViewCheck.check
    for k, (frame, _) in enumerate(wearer.frames(4, first=20)):
        deformed = k in (1, 2)
        monkeypatch.setattr(ViewCheck, "check", (lambda *_, **__: CONTRADICTED) if deformed else sound)
        motion = wearer.gait.at(np.array([frame.header.t_exposure_ns]))
        ground = estimator.estimate(frame, motion.R_WB[0], (0.0, 0.0, 0.0), np.zeros((3, 3)), v_W_mps=(0.0, 0.0, 0.0))
        told.append(ground.reason)
    assert told == [Reason.NOT_PLANAR, Reason.VIEW_DEFORMED, Reason.VIEW_DEFORMED, Reason.NOT_PLANAR]


@pytest.mark.parametrize("repeats", [False, True])
def test_on_a_floor_that_repeats_the_path_tells_nothing_of_ground_out_of_view(
    monkeypatch: pytest.MonkeyPatch, repeats: bool
) -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    estimator, cov = GroundEstimator(wearer.calibration, FootholdSettings()), np.zeros((3, 3))
    lip = Edge(0.75, 0.005, -0.6, 0.003, 0.0, 0.01, False)
    below = Surface(0.3, 0.75, 0.5, -1.6, 0.0, 0.002, 0.005)  # as tiles matched beside each other show it
    path = PathAhead((lip,), (replace(below, from_m=1.3, to_m=2.0),), shown_before=(below,))
    monkeypatch.setattr(RepetitionWatch, "repeats", lambda *_: repeats)
    frame, _ = next(iter(wearer.frames(1, first=20)))
    R_WB = wearer.gait.at(np.array([frame.header.t_exposure_ns])).R_WB[0]
    rest = (0.0, 0.0, 0.0)
    ground = estimator.estimate(frame, R_WB, rest, cov, v_W_mps=rest, place_m=(0.55, 0.0), path=path)
    if repeats:
        assert (ground.status, ground.reason) == (Status.INVALID, Reason.FOOTHOLD_OUT_OF_VIEW)
    else:
        assert ground.height_m == pytest.approx(1.6)


def test_a_plane_that_is_out_of_view_goes_on_with_every_step_of_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    wearer = SimulatedWearer(16, scenario("standing"), START_NS, perfect_calibration=True)
    estimator, cov, rest = GroundEstimator(wearer.calibration, FootholdSettings()), np.zeros((3, 3)), (0.0, 0.0, 0.0)
    frames = [frame for frame, _ in wearer.frames(7, first=20)]
    R_WB = wearer.gait.at(np.array([frames[0].header.t_exposure_ns])).R_WB[0]
    told = list[GroundPlane]()
    for k, frame in enumerate(frames):
        if k >= 2:  # the foot lands where the picture does not reach; in the last frame, what is there has been passed
            out_of_view = Aim(FootholdSettings().region, Reason.FOOTHOLD_OUT_OF_VIEW, passed=k == 6)
            monkeypatch.setattr("perception.ground.estimator.aimed", MagicMock(return_value=out_of_view))
        falls_mps = (0.0, 0.0, -0.8) if 2 <= k < 5 else rest
        told.append(estimator.estimate(frame, R_WB, rest, cov, v_W_mps=falls_mps))
    assert [ground.status is Status.VALID for ground in told] == [False, True, False, False, False, False, True]
    assert told[6].height_m == pytest.approx(told[1].height_m - 3 * 0.05 * 0.8, abs=0.001)


def test_on_a_poured_floor_the_ground_goes_on_where_matches_scatter() -> None:
    """Of these frames of faint texture most have more noise than any other ground, about one plane."""
    pairs, _ = seen("plain-floor", 6, 50, 20)
    valid = [(ground, truth) for ground, truth in pairs if ground.status is Status.VALID]
    assert len(valid) >= 15
    for ground, truth in valid:
        assert abs(ground.height_m - truth.height_m) < 4.0 * math.sqrt(ground.covariance[5])
