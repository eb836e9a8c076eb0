import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages import Quaternion, Vec3
from perception import so3
from perception.attitude.history import AttitudeAt, AttitudeHistory, OutsideHistoryError

PERIOD_NS = 10_000_000
RATE = (0.3, -0.2, 2.0)


def known(t_ns: int, q_WB: Quaternion, w_WB_B: Vec3 = RATE, variance: float = 1e-4) -> AttitudeAt:
    return AttitudeAt(t_ns, q_WB, w_WB_B, 0.0, variance * np.eye(3))


def turning(count: int, first: int = 0) -> AttitudeHistory:
    """Return a history of a body that turns at RATE, one attitude each 10 ms."""
    history = AttitudeHistory()
    for i in range(first, first + count):
        turn = 0.01 * i
        q_WB = so3.positive(so3.quaternion_from_rotvec((turn * RATE[0], turn * RATE[1], turn * RATE[2])))
        history.append(known(i * PERIOD_NS, q_WB))
    return history


def test_attitude_at_any_instant_between_and_just_after() -> None:
    history = turning(50)
    for t_ns in (0, 123_456_789, 250_000_000, 489_999_999, 490_000_000, 494_999_999):
        at = history.at(t_ns)
        assert at.t_ns == t_ns
        assert at.q_WB[0] >= 0.0
        expected = Rotation.from_rotvec(1e-9 * t_ns * np.array(RATE)).as_matrix()
        np.testing.assert_allclose(at.R_WB, expected, atol=1e-9)
        np.testing.assert_allclose(at.w_WB_B, RATE)


def test_rate_is_interpolated() -> None:
    history = AttitudeHistory()
    history.append(known(0, so3.IDENTITY, (0.0, 0.0, 0.0)))
    history.append(known(PERIOD_NS, so3.IDENTITY, (1.0, 2.0, -4.0)))
    np.testing.assert_allclose(history.at(PERIOD_NS // 4).w_WB_B, (0.25, 0.5, -1.0))


def test_what_was_not_yet_corrected_is_no_surer_than_before() -> None:
    history = AttitudeHistory()
    history.append(known(0, so3.IDENTITY, variance=4e-4))
    history.append(known(PERIOD_NS, so3.IDENTITY, variance=1e-4))
    assert history.at(PERIOD_NS - 1).rotation_cov_W[0, 0] == 4e-4
    assert history.at(PERIOD_NS).rotation_cov_W[0, 0] == 1e-4
    assert history.at(PERIOD_NS + 1).rotation_cov_W[0, 0] == 1e-4


def test_refuses_what_it_does_not_know() -> None:
    history = turning(50, first=100)
    newest_ns = history.newest_ns
    assert newest_ns == 149 * PERIOD_NS
    with pytest.raises(OutsideHistoryError, match="the oldest is at 1000000000 ns"):
        history.at(100 * PERIOD_NS - 1)
    history.at(newest_ns + 5_000_000)
    with pytest.raises(OutsideHistoryError, match="reaches 5000000 ns farther"):
        history.at(newest_ns + 5_000_001)
    history.append(known(newest_ns + 300_000_000, so3.IDENTITY))
    with pytest.raises(OutsideHistoryError, match="a gap from 1490000000 to 1790000000 ns"):
        history.at(newest_ns + 1)
    history.clear()
    assert history.newest_ns is None
    with pytest.raises(OutsideHistoryError, match="the history is empty"):
        history.at(newest_ns)


def test_keeps_one_second_and_refuses_to_go_back() -> None:
    history = turning(1000)
    assert len(history) == 101
    history.at(899 * PERIOD_NS)
    with pytest.raises(OutsideHistoryError):
        history.at(899 * PERIOD_NS - 1)
    with pytest.raises(ValueError, match="must be later than the newest"):
        history.append(known(999 * PERIOD_NS, so3.IDENTITY))


def test_quaternions_of_opposite_sign_are_neighbours() -> None:
    history = AttitudeHistory()
    almost_half_turn = math.pi - 0.01
    history.append(known(0, so3.positive(so3.quaternion_from_rotvec((0.0, 0.0, almost_half_turn)))))
    history.append(known(PERIOD_NS, so3.positive(so3.quaternion_from_rotvec((0.0, 0.0, almost_half_turn + 0.02)))))
    np.testing.assert_allclose(history.at(PERIOD_NS // 2).R_WB, np.diag((-1.0, -1.0, 1.0)), atol=1e-9)
