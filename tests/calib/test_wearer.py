"""The wearer's height of half a minute of estimates, or one line that says why there is none."""

import math

import msgspec
import numpy as np
import pytest

from calib.wearer import WearerMeasurement
from messages import GroundPlane, Motion, Reason, Status, UserError
from tests.bench.told_ground import FRAME_NS, told_ground


def motion(k: int, speed_mps: float) -> Motion:
    invalid = Motion.invalid(t_exposure_ns=k * FRAME_NS, frame_seq=k, reason=Reason.NO_IMU, calibration_id="0")
    return msgspec.structs.replace(
        invalid, status=Status.VALID, reason=Reason.NONE, velocity_H_mps=(speed_mps, 0.0, 0.0)
    )


def measured(*parts: tuple[int, float, float]) -> WearerMeasurement:
    """Return what has seen parts of (frames, mean height, speed), a walker's hip rising and falling."""
    found, k, chance = WearerMeasurement(), 0, np.random.default_rng(5)
    for frames, height_m, speed_mps in parts:
        for _ in range(frames):
            k += 1
            bob_m = 0.022 * math.sin(0.57 * k) if speed_mps > 0.4 else 0.0
            found.add(told_ground(k, height_m + bob_m + chance.normal(0.0, 0.001)))
            found.add(motion(k, speed_mps))
    return found


def test_the_height_is_that_of_standing_with_what_it_may_be_off_by() -> None:
    height = measured((100, 0.97, 0.01), (300, 0.96, 1.2), (100, 0.97, 0.02)).height("walk")
    assert height.camera_height_m == pytest.approx(0.97, abs=0.001)
    assert 0.005 < height.std_m < 0.008  # half of what walking differs by, and 3 mm as stated


def test_sitting_is_left_out() -> None:
    height = measured((150, 0.97, 0.01), (300, 0.97, 1.2), (100, 0.57, 0.0)).height("walk")
    assert height.camera_height_m == pytest.approx(0.97, abs=0.001)


@pytest.mark.parametrize(
    ("parts", "line"),
    [
        ([(20, 0.97, 0.0), (60, 0.97, 1.2)], "walk: 80 of 80 frames show valid ground and motion, allowed from 150"),
        ([(10, 0.97, 0.0), (300, 0.97, 1.2)], "walk: 10 valid frames of standing found, allowed from 40"),
        ([(300, 0.97, 0.0), (30, 0.97, 1.2)], "walk: 30 valid frames of walking found, allowed from 100"),
        ([(300, 0.57, 0.0), (150, 0.97, 1.2)], "0.570 m high while standing and 0.97"),
        ([(300, 1.7, 0.0), (150, 1.7, 1.2)], "walk: the camera is 1.700 m high, allowed 0.5 to 1.6 m"),
    ],
)
def test_what_cannot_be_measured_is_one_line(parts: list[tuple[int, float, float]], line: str) -> None:
    with pytest.raises(UserError) as raised:
        measured(*parts).height("walk")
    assert line in str(raised.value)
    assert "\n" not in str(raised.value)


def test_ground_that_is_not_valid_does_not_count() -> None:
    found = measured((150, 0.97, 0.01), (300, 0.97, 1.2))
    invalid = GroundPlane.invalid(
        t_exposure_ns=1, frame_seq=9, reason=Reason.LOW_TEXTURE, ahead_m=0.7, calibration_id="0"
    )
    before = found.height("walk")
    found.add(invalid)
    found.add(motion(0, 1.2))
    assert found.height("walk") == before
    assert found.frames == 451
