"""What the foothold says of the ground beside a change of the slope."""

import math

import numpy as np

from messages import GroundPlane, Reason, Side, Status, TerrainKind, upper_triangle
from perception.gait.gait import Gait, NextSteps
from perception.gait.landing import Landing
from perception.terrain.path_ahead import PathAhead
from perception.terrain.surfaces import Surface
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

FRAME_NS = 50_000_000
LEVEL = Surface(0.9, 2.0, 1.4, -0.9, 0.0, 0.001, 0.001)
RAMP_TO_LEVEL = PathAhead(surfaces=(Surface(0.3, 0.9, 0.6, -0.87, -0.1, 0.001, 0.001), LEVEL))
LEVEL_ALONE = PathAhead(surfaces=(LEVEL,))


def test_a_bend_that_has_passed_out_of_the_picture_is_told_until_the_foot_is_there() -> None:
    wearer = SimulatedWearer(1, scenario("level"), 0)
    gait = Gait(wearer.calibration, np.eye(3), Side.RIGHT)

    def slope_sd_rad(frame: int, path: PathAhead) -> float:
        ground = GroundPlane(
            t_exposure_ns=frame * FRAME_NS,
            frame_seq=frame,
            status=Status.VALID,
            reason=Reason.NONE,
            slope_sagittal_rad=0.0,
            slope_frontal_rad=0.0,
            height_m=0.9,
            covariance=upper_triangle(1e-8 * np.eye(3)),
            ahead_m=0.8,
            matched_share=1.0,
            inlier_share=1.0,
            disparity_noise_px=0.1,
            calibration_id="",
        )
        landing = Landing(0.8, 0.03, 0.0, 0.02, 0.4, 0.02, 0.6)
        return gait.foothold(NextSteps(landing), ground, path, TerrainKind.LEVEL).slope_sagittal_sd_rad

    beside = [slope_sd_rad(frame, RAMP_TO_LEVEL) for frame in range(20)]
    after = [slope_sd_rad(frame, LEVEL_ALONE) for frame in range(20, 40)]
    assert math.isclose(min(beside), 0.05, rel_tol=1e-3)
    assert math.isclose(after[10], 0.05, rel_tol=1e-3)
    assert after[-1] < 1e-3
