"""The simulated wearer without real time: truth, frames and the stream of inputs."""

from itertools import islice

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages import NO_RESIDUAL, Frame, GroundTruth, ImuSample, StereoFrame, Tick
from perception.depth.rectify import Rectifier
from sim_rig.unit import RESIDUAL
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 7_000_000_000
AHEAD_M = 0.7


def wearer_of(name: str, seed: int = 1, *, perfect: bool = True) -> SimulatedWearer:
    return SimulatedWearer(seed, scenario(name), START_NS, perfect_calibration=perfect)


def heading_frame(wearer: SimulatedWearer, t_ns: int) -> tuple[Rotation, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Return R_WH and the left camera's position at a true instant, by way of perception's own rectification."""
    motion = wearer.gait.at(np.array([t_ns]))
    X_BL = wearer.unit.X_BL
    R_WC = motion.R_WB[0] @ np.array(X_BL.R) @ Rectifier(wearer.unit.stereo, 2).R_LC
    heading = np.arctan2(R_WC[1, 2], R_WC[0, 2])
    return Rotation.from_euler("z", heading), motion.p_WB_m[0] + motion.R_WB[0] @ np.array(X_BL.p_m)


@pytest.mark.parametrize(
    ("t_s", "kind"),
    [
        (1.0, "level"),
        (8.0, "ramp"),
        (9.5, "ramp"),
        (15.5, "ramp"),
        (24.25, "kerb"),
        (29.25, "stairs"),
        (37.0, "stairs"),
    ],
)
def test_truth_is_the_plane_through_the_ground_at_the_foothold_seen_from_H(t_s: float, kind: str) -> None:
    wearer = wearer_of("mixed")
    t_ns = START_NS + round(t_s * 1e9)
    truth = wearer.truth(t_ns, AHEAD_M, half_length_m=0.05)
    assert (truth.kind, truth.transition) == (kind, False)
    R_WH, p_WL = heading_frame(wearer, t_ns)
    world = wearer.scenario.world
    around_H = AHEAD_M * np.array([1.0, 0.0]) + 0.01 * np.array([[1.0, 0.0], [-1.0, 1.0], [-1.0, -1.0]])
    points_H = []
    for x, y in around_H:
        point_W = p_WL + R_WH.apply([x, y, 0.0])
        point_W[2] = world.heights(point_W[:1])[0]
        points_H.append(R_WH.inv().apply(point_W - p_WL))
    a, b, z0 = np.linalg.solve(np.column_stack((np.array(points_H)[:, :2], np.ones(3))), np.array(points_H)[:, 2])
    assert truth.slope_sagittal_rad == pytest.approx(np.arctan(a), abs=1e-9)
    assert truth.slope_frontal_rad == pytest.approx(np.arctan(b), abs=1e-9)
    assert truth.height_m == pytest.approx(-z0, abs=1e-9)
    assert Rotation.from_quat(truth.q_WB, scalar_first=True).as_matrix() == pytest.approx(
        wearer.gait.at(np.array([t_ns])).R_WB[0]
    )
    assert truth.q_WB[0] >= 0


def truths(name: str, seconds: float) -> list[GroundTruth]:
    wearer = wearer_of(name)
    return [wearer.truth(START_NS + round(t * 1e9)) for t in np.arange(0.0, seconds, 0.1)]


def test_truth_meets_every_kind_of_ground_standing_and_walking() -> None:
    walk = truths("mixed", 55.0)
    assert {truth.kind for truth in walk if not truth.transition} == {"level", "ramp", "kerb"}
    assert {truth.kind for truth in walk} == {"level", "ramp", "kerb", "stairs"}
    assert {truth.kind for truth in walk if truth.standing} >= {"level", "ramp"}
    assert 0.1 < np.mean([truth.standing for truth in walk]) < 0.3
    assert 0.1 < np.mean([truth.transition for truth in walk]) < 0.5
    uphill = np.rad2deg([t.slope_sagittal_rad for t in walk if t.kind == "ramp"])
    assert uphill.max() == pytest.approx(5.0, abs=0.1)
    assert uphill.min() == pytest.approx(-5.0, abs=0.1)
    assert np.mean([t.height_m for t in walk if t.kind == "level" and not t.transition]) == pytest.approx(
        0.95, abs=0.03
    )


def test_a_narrow_region_fits_on_a_tread() -> None:
    wearer = wearer_of("mixed")
    instants = [START_NS + round(t * 1e9) for t in np.arange(28.0, 38.0, 0.05)]
    on_stairs = [t for t in (wearer.truth(i, AHEAD_M, 0.05) for i in instants) if t.kind == "stairs"]
    assert any(not truth.transition for truth in on_stairs)
    assert any(truth.transition for truth in on_stairs)


def test_standing_only_stands() -> None:
    assert all(truth.standing and truth.kind == "level" for truth in truths("standing", 70.0))


def test_the_header_is_off_by_the_calibrations_time_error_and_truth_is_not() -> None:
    wearer = wearer_of("mixed", seed=2, perfect=False)
    error_s = (
        wearer.calibration.stereo.stamp_to_mid_exposure_s
        - wearer.unit.exact_calibration().stereo.stamp_to_mid_exposure_s
    )
    assert error_s != 0.0
    frame, truth = next(wearer.frames(1, first=140))
    true_ns = START_NS + 140 * 50_000_000
    assert frame.header.t_exposure_ns - true_ns == round(error_s * 1e9)
    assert truth.t_exposure_ns == frame.header.t_exposure_ns
    assert wearer.calibration.residual == RESIDUAL
    exact = wearer_of("mixed", seed=2).truth(true_ns)
    assert truth.height_m == exact.height_m
    assert truth.q_WB == exact.q_WB


def test_a_perfect_calibration_is_the_unit() -> None:
    wearer = wearer_of("mixed", seed=2)
    assert wearer.calibration == wearer.unit.exact_calibration()
    assert wearer.calibration.residual == NO_RESIDUAL


def test_frames_come_on_the_grid_and_arrive_as_from_a_zed() -> None:
    frames = [frame for frame, _ in wearer_of("standing").frames(4, first=3)]
    assert [frame.header.seq for frame in frames] == [3, 4, 5, 6]
    for k, frame in enumerate(frames, 3):
        header = frame.header
        assert header.t_exposure_ns == START_NS + k * 50_000_000
        assert 0.030 <= (header.t_arrival_ns - header.t_exposure_ns) * 1e-9 <= 0.045
        assert 0.004 <= header.exposure_s <= 0.008
        assert frame.left.shape == (header.height_px, header.width_px) == (720, 1280)
        assert not frame.left.flags.writeable
    assert len({frame.header.t_arrival_ns - frame.header.t_exposure_ns for frame in frames}) == 4


def test_frame_k_is_the_same_wherever_the_iteration_began() -> None:
    wearer = wearer_of("mixed")
    straight = [frame for frame, _ in wearer.frames(3, first=80)][2]
    (alone,) = [frame for frame, _ in wearer_of("mixed").frames(1, first=82)]
    np.testing.assert_array_equal(straight.left, alone.left)
    np.testing.assert_array_equal(straight.right, alone.right)
    assert straight.header == alone.header


def test_offline_inputs_are_what_the_devices_give_in_order_of_arrival() -> None:
    wearer = wearer_of("level")
    inputs = list(wearer.offline_inputs(2.0))
    samples = [message for message in inputs if isinstance(message, ImuSample)]
    frames = [message for message in inputs if isinstance(message, StereoFrame)]
    ticks = [message for message in inputs if isinstance(message, Tick)]
    assert len(ticks) == 200
    assert len(frames) in (39, 40)
    assert len(samples) / (samples[-1].t_sample_ns - samples[0].t_sample_ns) * 1e9 == pytest.approx(100.0, rel=0.015)
    assert sum(sample.lost_before for sample in samples) == 0

    def arrival_ns(message: ImuSample | Frame | Tick) -> int:
        if isinstance(message, Frame):
            return message.header.t_arrival_ns
        return message.t_ns if isinstance(message, Tick) else message.t_arrival_ns

    arrivals = np.array([arrival_ns(message) for message in inputs])
    assert np.diff(arrivals).min() > -2_000_000  # a poll that is under way when a frame comes is told first
    assert arrivals[-1] < START_NS + 2_000_000_000


def test_offline_samples_calibrated_are_the_true_motion() -> None:
    wearer = wearer_of("level", seed=3)
    samples = [m for m in wearer.offline_inputs(2.2) if isinstance(m, ImuSample)]
    imu = wearer.calibration.imu
    t_ns = np.array([sample.t_sample_ns for sample in samples])
    sf_B, w_B = wearer.gait.imu(t_ns)
    measured_sf = (np.array([s.sf_B_mps2 for s in samples]) - imu.sf_bias_mps2) @ np.array(imu.sf_matrix).T
    measured_w = (np.array([s.w_WB_B_radps for s in samples]) - imu.w_bias_radps) @ np.array(imu.w_matrix).T
    np.testing.assert_allclose(measured_sf.mean(axis=0), sf_B.mean(axis=0), atol=0.01)
    np.testing.assert_allclose(np.rad2deg((measured_w - w_B).mean(axis=0)), 0.0, atol=0.15)
    assert (measured_sf - sf_B).std() < 0.06
    assert np.rad2deg((measured_w - w_B).std()) < 0.1


def test_two_runs_give_the_same_inputs() -> None:
    first, second = (wearer_of("mixed", seed=4, perfect=False).offline_inputs(60.0) for _ in range(2))
    for one, other in zip(islice(first, 120), islice(second, 120), strict=True):
        if isinstance(one, StereoFrame) and isinstance(other, StereoFrame):
            assert one.header == other.header
            np.testing.assert_array_equal(one.left, other.left)
            np.testing.assert_array_equal(one.right, other.right)
        else:
            assert one == other


def test_a_frame_where_a_stair_shows_only_in_a_corner_of_its_box_is_rendered() -> None:
    wearer = SimulatedWearer(37, scenario("mixed"), 10_000_000_000)
    frame, _ = next(iter(wearer.frames(1, first=307)))
    assert frame.left.std() > 10.0
