"""Which calibrations are fit to be worn, and what the others lack."""

import math

import msgspec
import numpy as np
import pytest

from calib.files import check_calibration
from calib.fitness import Shortcoming, shortcomings
from calib.nominal import (
    NOMINAL_LENS_RESIDUAL,
    known_optics,
    nominal_lens,
    nominal_stereo,
    uncalibrated_depth_unit,
    uncalibrated_unit,
)
from messages import UnitCalibration
from sim_rig.camera.depth_unit import draw_depth_unit
from sim_rig.unit import draw_unit

LENS = nominal_lens(1280, 720, math.radians(85.0))


def faults(calibration: UnitCalibration) -> list[str]:
    return [each.what for each in shortcomings(calibration) if each.is_fault]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_careful_calibration_is_fit(seed: int) -> None:
    assert list(shortcomings(draw_unit(seed).calibration(np.random.default_rng(seed)))) == []
    assert list(shortcomings(draw_depth_unit(seed, perfect_calibration=False)[1])) == []


def test_a_unit_known_by_its_drawings_is_not() -> None:
    stereo = nominal_stereo(LENS, 0.12)
    known_lenses = uncalibrated_unit("a", stereo)
    assert faults(known_lenses) == ["camera to IMU ± 3.0°", "accelerometer ± 61 mg, 3.5° of tilt"]
    nothing_known = uncalibrated_unit("b", stereo, NOMINAL_LENS_RESIDUAL)
    assert faults(nothing_known)[2:] == ["distances ± 20.4 %", "rows of the eyes ± 7.0 px"]
    for each in (known_lenses, nothing_known, uncalibrated_depth_unit("c", LENS, 0.05)):
        check_calibration(each, "nominal")
        assert faults(each)


@pytest.mark.parametrize(
    ("residual", "found"),
    [
        ({"camera_to_imu_rad": math.radians(0.31)}, [("camera to IMU ± 0.3°", False)]),
        ({"camera_to_imu_rad": math.radians(1.01)}, [("camera to IMU ± 1.0°", True)]),
        ({"time_s": 0.026}, [("time of the pictures ± 26 ms", True)]),
        ({"rows_rad": 1e-3}, [("rows of the eyes ± 0.7 px", False)]),
        ({"baseline": 0.02}, [("distances ± 2.0 %", False)]),
        ({"focal_length": 0.031}, [("distances ± 3.1 %", True)]),
        ({"scale": 0.02}, [("scale of the IMU ± 2.0 %", False)]),
    ],
)
def test_each_term_has_its_limits(residual: dict[str, float], found: list[tuple[str, bool]]) -> None:
    sound = draw_unit(1).exact_calibration()
    worse = msgspec.structs.replace(sound, residual=msgspec.structs.replace(sound.residual, **residual))
    assert [(each.what, each.is_fault) for each in shortcomings(worse)] == found


def test_what_mends_it_is_a_command_of_its_own() -> None:
    lacking = shortcomings(uncalibrated_unit("a", nominal_stereo(LENS, 0.12), NOMINAL_LENS_RESIDUAL))
    assert {each.cure for each in lacking} == {
        "gaiteyes calibrate mount",
        "gaiteyes calibrate imu",
        "gaiteyes calibrate stereo",
    }
    assert isinstance(next(shortcomings(uncalibrated_depth_unit("c", LENS, 0.05))), Shortcoming)


@pytest.mark.parametrize(("card", "f_px"), [("ZED 2: ZED 2", 530.0), ("ZED-M: ZED-M", 700.0), ("ZED: ZED", 700.0)])
def test_a_zed_is_known_by_its_name(card: str, f_px: float) -> None:
    optics = known_optics(card)
    assert optics is not None
    assert nominal_lens(1280, 720, optics.view_rad).fx_px == pytest.approx(f_px)
    assert known_optics("Webcam") is None
