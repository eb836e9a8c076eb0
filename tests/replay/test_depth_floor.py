"""Measured depth of a real concrete floor, by structured light, against the plane that was fitted to it elsewhere."""

import json

import cv2
import numpy as np
import pytest

from lab.evaluation.measured.robot_floor import level_heading
from lab.evaluation.real_pair import FLOOR
from messages import DepthCalibration, Lens, Residual
from perception.ground.meter import GroundMeter
from tests.bench.data_folder import shared_data


@pytest.mark.parametrize("step_m", [0.001, 0.00025])
def test_the_floor_in_a_depth_image_is_the_plane_of_its_points(step_m: float) -> None:
    folder = shared_data("middlebury_motorcycle_720p")
    facts = json.loads((folder / "calib.json").read_text())
    true = json.loads((folder / "floor_plane_from_truth.json").read_text())
    stored = cv2.imread(str(folder / "disp_left_x64.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    disparity_px = stored / facts["disparity_png_scale"] + facts["doffs_px"]
    z_m = facts["fx"] * facts["baseline_m"] / disparity_px
    image = np.where(stored > 0, np.rint(z_m / step_m), 0.0).astype(np.uint16)
    lens = Lens(
        width_px=facts["width"],
        height_px=facts["height"],
        fx_px=facts["fx"],
        fy_px=facts["fy"],
        cx_px=facts["cx_left"],
        cy_px=facts["cy"],
        distortion=(0.0,) * 4,
    )
    R_HC = level_heading(np.array(true["normal_up_in_left_camera"]))  # in this H the floor is level

    meter = GroundMeter(DepthCalibration(lens=lens, baseline_m=facts["baseline_m"], step_m=step_m), Residual())
    found = meter.measure((image,), R_HC, np.zeros(3), 0.0, FLOOR, None)
    assert found.fit is not None
    assert found.matched_share > 0.8
    assert found.fit.inlier_share > 0.6  # a wheel stands in the region
    assert np.degrees(found.fit.plane.steepness_rad) < 0.15  # least squares of its points' heights: 0.18° off the other
    assert abs(found.fit.plane.height_m - true["camera_height_m"]) < 0.004
