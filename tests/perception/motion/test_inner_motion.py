"""The motion within a step: from the samples of a simulated walk, against its truth; none where samples are missing."""

from dataclasses import replace

import numpy as np
import pytest

from messages import Vec3, vec3
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception import so3
from perception.attitude.foretold import MotionForetold
from perception.motion.inner_motion import RecentSamples, steady_motion
from sim_rig.walk.gait import Gait
from tests.bench.seen_motion import P_BC_M, R_BC, START_NS, gait, imu_samples

BEFORE_NS, AFTER_NS, MARGIN_NS = START_NS + 4_003_000_000, START_NS + 4_053_000_000, 8_000_000
AT_REST: Vec3 = (0.01, -0.02, 0.03)
"""What the gyroscope errs by."""


@pytest.fixture(scope="module")
def walk() -> Gait:
    return gait(5)


def samples_until(walk: Gait, until_ns: int, left_out: slice = slice(0, 0)) -> RecentSamples:
    samples = RecentSamples(R_BC, vec3(P_BC_M))
    every = imu_samples(walk, AFTER_NS - 300_000_000, until_ns)
    del every[left_out]
    for each in every:
        samples.add(each.t_ns, each.sf_B_mps2, vec3(np.add(each.w_B_radps, AT_REST)))
    return samples


def foretold(walk: Gait, t_ns: int) -> MotionForetold:
    truth = walk.at(np.array([t_ns]))
    R_BW = truth.R_WB[0].T
    up_B, v_B = R_BW[:, 2], R_BW @ truth.v_WB_mps[0]
    return MotionForetold(t_ns, AT_REST, vec3(STANDARD_GRAVITY_MPS2 * up_B), vec3(v_B), np.diag([1e-4] * 6))


def true_motion(walk: Gait, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the attitude (n, 3, 3) and the place (n, 3) of C, in C as it was at `BEFORE_NS`."""
    truth = walk.at(np.array([BEFORE_NS, *(BEFORE_NS + np.rint(1e9 * times_s).astype(np.int64))]))
    R_WC, centre_W = truth.R_WB @ R_BC, truth.p_WB_m + truth.R_WB @ P_BC_M
    return R_WC[0].T @ R_WC[1:], (centre_W[1:] - centre_W[0]) @ R_WC[0]


def test_turn_and_travel_of_every_row_are_the_true_ones(walk: Gait) -> None:
    newest_ns = AFTER_NS + 22_000_000
    inner = samples_until(walk, newest_ns).inner_motion(
        BEFORE_NS, AFTER_NS, MARGIN_NS, foretold(walk, newest_ns), np.zeros(3)
    )
    assert inner is not None
    times_s = np.linspace(-0.008, 0.058, 34)
    (R, p_m), (true_R, true_p_m) = inner.at(times_s), true_motion(walk, times_s)
    turns_rad = [np.linalg.norm(so3.log(a.T @ b)) for a, b in zip(R, true_R, strict=True)]
    assert max(turns_rad) < np.radians(0.05)
    assert np.abs(p_m - true_p_m).max() < 0.0005
    assert inner.foretold is not None
    assert not inner.noise.any()


def test_what_nothing_foretells_is_a_velocity_and_how_far_that_is_off_is_stated(walk: Gait) -> None:
    inner = samples_until(walk, AFTER_NS + 22_000_000).inner_motion(
        BEFORE_NS, AFTER_NS, MARGIN_NS, None, np.array([0.1, 0.2, 0.3])
    )
    assert inner is not None
    assert inner.foretold is None
    assert (inner.noise > 0.0).all()
    R, p_m = inner.at(np.array([0.05]))
    true_R, _ = true_motion(walk, np.array([0.05]))
    assert np.linalg.norm(so3.log(R[0].T @ true_R[0])) < np.radians(0.2)  # the bias among it
    assert np.linalg.norm(p_m[0] - np.array([0.005, 0.01, 0.015])) < 0.01  # the lever's turn among it


def test_the_vertical_alone_tells_how_the_velocity_changes_within_the_step(walk: Gait) -> None:
    newest_ns = AFTER_NS + 22_000_000
    samples, times_s = samples_until(walk, newest_ns), np.linspace(-0.008, 0.058, 34)
    truth = walk.at(np.array([BEFORE_NS]))
    v_C = R_BC.T @ truth.R_WB[0].T @ truth.v_WB_mps[0]
    _, true_p_m = true_motion(walk, times_s)
    off_m = []
    for told in (None, replace(foretold(walk, newest_ns), covariance=None)):
        inner = samples.inner_motion(BEFORE_NS, AFTER_NS, MARGIN_NS, told, v_C)
        assert inner is not None
        assert inner.foretold is None
        assert (inner.noise > 0.0).all()
        off_m.append(float(np.abs(inner.at(times_s)[1] - true_p_m).max()))
    assert off_m[1] < 0.001
    assert off_m[0] > 3.0 * off_m[1]


def test_rows_after_the_newest_sample_go_on_at_its_rate(walk: Gait) -> None:
    newest_ns = AFTER_NS + 1_000_000
    inner = samples_until(walk, newest_ns).inner_motion(
        BEFORE_NS, AFTER_NS, MARGIN_NS, foretold(walk, newest_ns), np.zeros(3)
    )
    assert inner is not None
    (R, _), (true_R, _) = (motion(np.array([0.058])) for motion in (inner.at, lambda t_s: true_motion(walk, t_s)))
    assert np.linalg.norm(so3.log(R[0].T @ true_R[0])) < np.radians(0.3)


@pytest.mark.parametrize("left_out", [slice(0, 26), slice(26, 30), slice(24, None)])
def test_missing_samples_tell_nothing(walk: Gait, left_out: slice) -> None:
    samples = samples_until(walk, AFTER_NS, left_out)
    assert samples.inner_motion(BEFORE_NS, AFTER_NS, MARGIN_NS, None, np.zeros(3)) is None


def test_steady_motion_is_what_it_says() -> None:
    inner = steady_motion(np.array([0.0, 0.0, 0.4, 1.0, 0.0, 0.0]))
    R, p_m = inner.at(np.array([-0.01, 0.05]))
    assert np.allclose(p_m[:, 0], [-0.01, 0.05])
    assert np.allclose(so3.log(R[1]), [0.0, 0.0, 0.02])
