"""Depth pictures of a real floor from a robot that drives: one height in all of them, and no edge twice."""

import numpy as np

from lab.evaluation.measured.robot_floor import floors_seen
from tests.bench.data_folder import shared_data

SPREAD_M = 0.003


def test_a_real_floor_has_one_height_in_all_depth_pictures_and_no_edge_that_lasts() -> None:
    seen = floors_seen(shared_data("realsense_robot_floor"))
    heights_m = np.array([floor.height_m for floor in seen])
    assert len(seen) == 20
    assert np.isfinite(heights_m).all()
    assert heights_m.std() < SPREAD_M
    assert sum(bool(floor.edges) for floor in seen) <= 1  # memory tells an edge once three frames have seen it
