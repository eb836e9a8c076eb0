"""The wearer of a depth camera: the ground seen in its frames against the truth, with and without a residual."""

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from daemon.pipeline import Pipeline
from lab.evaluation.offline import score_walk
from messages import (
    DepthFrame,
    Frame,
    GroundPlane,
    GroundTruth,
    ImuSample,
    Reason,
    Status,
    StereoFrame,
    Tick,
    UserError,
)
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from sim_rig.camera.depth_renderer import DepthErrors
from sim_rig.camera.depth_unit import SCALE_RESIDUAL, draw_depth_unit
from sim_rig.depth_wearer import DepthWearer
from sim_rig.unit import RESIDUAL, draw_unit
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000


def seen(wearer: DepthWearer, first: int, count: int) -> list[tuple[GroundPlane, GroundTruth]]:
    """Return estimates with the true attitude, and their truth."""
    estimator = GroundEstimator(wearer.calibration, FootholdSettings())
    pairs = []
    for frame, truth in wearer.frames(count, first=first):
        motion = wearer.gait.at(np.array([wearer.shutter.true_of(frame.header.t_exposure_ns)]))
        w = tuple(motion.w_WB_B_radps[0].tolist())
        pairs.append((estimator.estimate(frame, motion.R_WB[0], w, np.zeros((3, 3))), truth))
    return pairs[1:]  # the first waits for its confirmation


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
def test_slope_and_height_agree_with_the_truth(name: str, seed: int, first: int) -> None:
    pairs = seen(DepthWearer(seed, scenario(name), START_NS, perfect_calibration=True), first, 30)
    assert all(ground.status is Status.VALID for ground, _ in pairs)
    rms = np.sqrt((errors(pairs) ** 2).mean(axis=0))
    assert np.degrees(rms[0]) < 0.3
    assert np.degrees(rms[1]) < 0.2
    assert rms[2] < 0.004


def test_the_stated_uncertainty_covers_units_with_their_residual() -> None:
    within = []
    for seed in range(41, 49):
        pairs = seen(DepthWearer(seed, scenario("level"), START_NS), 80, 2)
        stated = np.array([ground.covariance for ground, _ in pairs])[:, [0, 3, 5]]
        within.append(np.abs(errors(pairs)) <= 1.96 * np.sqrt(stated))
    assert np.concatenate(within).mean() > 0.85


def test_the_noise_it_finds_is_that_of_the_inner_pair() -> None:
    wearer = DepthWearer(
        17, scenario("standing"), START_NS, perfect_calibration=True, errors=DepthErrors(noise_px=0.15)
    )
    [(ground, _)] = seen(wearer, 20, 2)
    assert ground.disparity_noise_px == pytest.approx(0.15, rel=0.25)


def test_a_stereo_frame_is_of_the_wrong_size_for_a_depth_unit_and_the_reverse() -> None:
    depth = DepthWearer(16, scenario("standing"), START_NS)
    stereo = SimulatedWearer(16, scenario("standing"), START_NS)
    R_WB = stereo.gait.at(np.array([START_NS])).R_WB[0]
    stereo_frame, depth_frame = next(iter(stereo.frames(1)))[0], next(iter(depth.frames(1)))[0]
    for estimator, frame in (
        (GroundEstimator(depth.calibration, FootholdSettings()), stereo_frame),
        (GroundEstimator(stereo.calibration, FootholdSettings()), depth_frame),
    ):
        assert isinstance(frame, Frame)
        assert estimator.estimate(frame, R_WB, (0.0, 0.0, 0.0), np.zeros((3, 3))).reason is Reason.WRONG_SIZE


def test_the_pipeline_says_the_ground_from_depth_frames() -> None:
    wearer = DepthWearer(3, scenario("standing"), START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    grounds, kinds = [], set()
    for message in wearer.offline_inputs(2.0):
        kinds.add(type(message))
        grounds += [e for e in pipeline.step(message) if isinstance(e, GroundPlane) and e.status is Status.VALID]
    assert kinds == {ImuSample, Tick, DepthFrame}
    assert len(grounds) > 15
    assert {ground.calibration_id for ground in grounds} == {wearer.calibration.id}
    truth = wearer.truth(grounds[-1].t_exposure_ns)
    assert grounds[-1].height_m == pytest.approx(truth.height_m, abs=0.02)


def test_a_frozen_depth_image_is_refused() -> None:
    wearer = DepthWearer(3, scenario("standing"), START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    frozen = None
    reasons = []
    for message in wearer.offline_inputs(2.5):
        if isinstance(message, DepthFrame):
            frozen = frozen if frozen is not None else message.depth
            message = msgspec.structs.replace(message, depth=frozen)
        reasons += [estimate.reason for estimate in pipeline.step(message) if isinstance(estimate, GroundPlane)]
    assert reasons[-1] is Reason.FROZEN_FRAME
    assert not isinstance(message, StereoFrame)


def test_the_unit_has_the_chip_of_its_stereo_twin_and_a_residual_as_large_as_stated() -> None:
    late, turned, toe_in, scale = [], [], [], []
    for seed in range(60):
        unit, stated = draw_depth_unit(seed, perfect_calibration=False)
        np.testing.assert_array_equal(unit.chip.sf_matrix, draw_unit(seed).chip.sf_matrix)
        late.append(stated.depth.stamp_to_mid_exposure_s - unit.depth.stamp_to_mid_exposure_s)
        tilt = np.array(stated.X_BD.R) @ np.array(unit.X_BD.R).T
        turned.append(Rotation.from_matrix(tilt).as_rotvec())
        toe_in.append(unit.toe_in_rad)
        scale.append(unit.scale_error)
    assert np.std(late) == pytest.approx(RESIDUAL.time_s, rel=0.3)
    assert np.std(turned) == pytest.approx(RESIDUAL.camera_to_imu_rad, rel=0.2)
    assert np.std(toe_in) == pytest.approx(RESIDUAL.toe_in_rad, rel=0.3)
    assert np.std(scale) == pytest.approx(SCALE_RESIDUAL, rel=0.3)
    assert stated.depth.scale_residual == SCALE_RESIDUAL


def test_an_unknown_camera_is_refused_in_one_line() -> None:
    with pytest.raises(UserError, match="camera is 'sonar', known are stereo, depth"):
        score_walk(1, "standing", 5.0, camera="sonar")
