"""A real stereo video of a floor from above: nothing jumps, and a slip that is put into it is noticed at once."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from lab.faults.deformed_view import turned_eye
from messages import Lens, Pose, Reason, StereoCalibration, matrix3, vec3
from messages.arrays import FloatArray, GreyImage
from perception import so3
from perception.motion.ego_motion import VisualOdometer
from perception.motion.eyes import Eyes
from sim_rig.unit import draw_unit
from tests.bench.data_folder import shared_data

FRAME_NS = 50_000_000
ROWS_OFF_PX = 1
"""The factory calibration is that far out of date; what remains is a fraction of a pixel."""


def calibration(folder: Path) -> StereoCalibration:
    """Return the pair's factory calibration, centimetres there."""
    cameras = dict(json.loads((folder / "calib.json").read_text())["cameraData"])
    place = cameras[1]["extrinsics"]
    assert place["toCameraSocket"] == 2
    p_m = 0.01 * np.array([place["translation"][axis] for axis in "xyz"])
    X_RL = Pose(R=matrix3(place["rotationMatrix"]), p_m=vec3(p_m))
    return StereoCalibration(left=lens(cameras[1]), right=lens(cameras[2]), X_RL=X_RL)


def lens(camera: dict[str, object]) -> Lens:
    K = np.array(camera["intrinsicMatrix"], dtype=np.float64)
    distortion = np.array(camera["distortionCoeff"], dtype=np.float64).tolist()
    return Lens(
        width_px=1280,
        height_px=800,
        fx_px=K[0, 0],
        fy_px=K[1, 1],
        cx_px=K[0, 2],
        cy_px=K[1, 2],
        distortion=tuple(distortion),
    )


def pairs(folder: Path) -> Iterator[tuple[GreyImage, GreyImage]]:
    videos = [cv2.VideoCapture(str(folder / name)) for name in ("left.mp4", "right.mp4")]
    while True:
        (seen_left, left), (seen_right, right) = (video.read() for video in videos)
        if not (seen_left and seen_right):
            return
        yield grey(left), np.roll(grey(right), -ROWS_OFF_PX, axis=0)


def grey(picture: NDArray[Any]) -> GreyImage:
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)


@pytest.mark.long
@pytest.mark.parametrize("slip_px", [0, -4])
def test_distances_jump_in_a_real_video_where_an_eye_slips_and_nowhere_else(slip_px: int) -> None:
    folder = shared_data("oakd_balcony_floor")
    odometer, jumps_px, contradicts = VisualOdometer(calibration(folder)), list[float](), list[bool]()
    for number, (left, right) in enumerate(pairs(folder)):
        slipped = np.roll(right, slip_px, axis=1) if 100 <= number < 200 else right
        odometer.add_frame(1_000_000_000 + number * FRAME_NS, left, slipped)
        odometer.prepare_next()
        jumps_px.append(odometer.jumps.newest_px)
        contradicts.append(odometer.jumps.contradict)
        assert not odometer.torn.contradicts
    told = np.isfinite(jumps_px)
    assert len(told) == 326
    assert np.count_nonzero(told) > 310
    expected = [slip_px != 0 and 100 <= number < 200 for number in range(len(contradicts))]
    assert contradicts == expected
    still = [jump for number, jump in enumerate(jumps_px) if told[number] and number not in (100, 200)]
    assert max(still) < 0.25  # of 0.4, which counts as a jump


@pytest.mark.long
def test_a_pair_whose_calibration_is_out_of_date_is_told_though_the_camera_stands_and_others_move() -> None:
    """Its rows tell 2.7 mrad of roll and 2.4 of toe-in; a fifth to a third of the corners move by themselves."""
    folder = shared_data("oakd_balcony_floor")
    eyes, told = (
        Eyes(msgspec.structs.replace(draw_unit(1).exact_calibration(), stereo=calibration(folder))),
        list[Reason](),
    )
    for number, (left, right) in enumerate(pairs(folder)):
        eyes.add_frame(1_000_000_000 + number * FRAME_NS, left, right, None)
        eyes.finish_frame()
        told.append(eyes.reason)
    assert set(told[100:]) == {Reason.EYES_MISALIGNED}


@pytest.mark.long
@pytest.mark.parametrize(("axis", "term"), [((0.0, 0.0, 1.0), 0), ((0.0, 1.0, 0.0), 2)], ids=["rolled", "toed"])
def test_by_how_much_an_eye_is_turned_is_seen_in_its_rows(axis: tuple[float, float, float], term: int) -> None:
    folder, turn_rad = shared_data("oakd_balcony_floor"), np.radians(0.5)
    still, turned = rows_of(folder, np.eye(3)), rows_of(folder, so3.exp(turn_rad * np.array(axis)))
    assert turned[term] - still[term] == pytest.approx(turn_rad, rel=0.15)
    others = np.delete(turned - still, term)
    assert np.abs(others).max() < 0.15 * turn_rad


def rows_of(folder: Path, R: FloatArray) -> FloatArray:
    """Return roll, focal difference and toe-in (3,) of the right eye turned by R, the median of sixty frames."""
    stereo = calibration(folder)
    odometer, change, told = VisualOdometer(stereo), turned_eye(stereo, R, left=False), list[FloatArray]()
    for number, (left, right) in enumerate(islice(pairs(folder), 60)):
        odometer.add_frame(1_000_000_000 + number * FRAME_NS, *change((left, right)))
        odometer.prepare_next()
        if odometer.skew is not None:
            told.append(odometer.skew.by_place)
    assert len(told) > 50
    median: FloatArray = np.median(told, axis=0)
    return median
