"""An estimate without numbers says why, and holds NaN in place of each of them."""

import json
import math

import msgspec
import pytest

from messages import Attitude, GroundPlane, Health, Motion, Reason, Status
from messages.codec import decode, encode
from tests.bench.can_samples import health


def numbers(estimate: msgspec.Struct, *names: str) -> list[float]:
    values = [getattr(estimate, name) for name in names]
    return [number for value in values for number in (value if isinstance(value, tuple) else (value,))]


@pytest.mark.parametrize("reason", [reason for reason in Reason if reason is not Reason.NONE])
def test_an_attitude_without_numbers(reason: Reason) -> None:
    found = Attitude.invalid(t_sample_ns=7, reason=reason, calibration_id="a3f01234")
    assert (found.t_sample_ns, found.reason, found.calibration_id) == (7, reason, "a3f01234")
    nan = numbers(found, "q_WB", "w_WB_B_radps", "gyro_bias_B_radps", "rotation_cov_W_rad2")
    assert len(nan) == 4 + 3 + 3 + 6
    assert all(map(math.isnan, nan))


@pytest.mark.parametrize("reason", [reason for reason in Reason if reason is not Reason.NONE])
def test_a_ground_without_numbers_tells_where_it_looked_and_what_it_matched(reason: Reason) -> None:
    found = GroundPlane.invalid(
        t_exposure_ns=7, frame_seq=3, reason=reason, ahead_m=0.6, calibration_id="a3f01234", matched_share=0.25
    )
    assert (found.t_exposure_ns, found.frame_seq, found.reason, found.calibration_id) == (7, 3, reason, "a3f01234")
    assert (found.ahead_m, found.matched_share) == (0.6, 0.25)
    nan = numbers(
        found,
        "slope_sagittal_rad",
        "slope_frontal_rad",
        "height_m",
        "covariance",
        "inlier_share",
        "disparity_noise_px",
    )
    assert len(nan) == 3 + 6 + 2
    assert all(map(math.isnan, nan))


@pytest.mark.parametrize("reason", [reason for reason in Reason if reason is not Reason.NONE])
def test_a_motion_without_numbers(reason: Reason) -> None:
    found = Motion.invalid(t_exposure_ns=7, frame_seq=3, reason=reason, calibration_id="a3f01234")
    assert (found.t_exposure_ns, found.frame_seq, found.reason, found.calibration_id) == (7, 3, reason, "a3f01234")
    names = ("velocity_H_mps", "rate_H_radps", "distance_m", "velocity_cov_H", "rate_cov_H", "distance_var_m2")
    nan = numbers(found, *names)
    assert len(nan) == 3 + 3 + 1 + 6 + 6 + 1
    assert all(map(math.isnan, nan))


def test_only_the_start_is_initialising_and_no_reason_is_valid() -> None:
    starting = {reason for reason in Reason if reason.status is Status.INITIALISING}
    assert starting == {Reason.STARTING, Reason.NOT_AT_REST}
    assert [reason for reason in Reason if reason.status is Status.VALID] == [Reason.NONE]


def test_nothing_without_numbers_is_valid() -> None:
    with pytest.raises(ValueError, match="says why"):
        Attitude.invalid(t_sample_ns=7, reason=Reason.NONE, calibration_id="a3f01234")
    with pytest.raises(ValueError, match="says why"):
        GroundPlane.invalid(t_exposure_ns=7, frame_seq=3, reason=Reason.NONE, ahead_m=0.6, calibration_id="a3f01234")


def test_health_from_before_the_wearers_height_is_read() -> None:
    older = json.loads(encode(health()))
    del older["height_off_m"], older["height_contradicts"]
    read = decode(json.dumps(older), Health)
    assert math.isnan(read.height_off_m)
    assert not read.height_contradicts
