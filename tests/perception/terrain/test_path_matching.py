"""What was begun before a frame's attitude was known is used only where it was about right."""

import numpy as np
import pytest

from perception import so3
from perception.terrain.path_matching import PathMatching

LOOKS_DOWN = so3.exp(np.array([-0.8, 0.0, 0.0]))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("turned_deg", "serves"), [(0.0, True), (0.9, True), (1.1, False), (-30.0, False)])
def test_the_path_is_matched_again_where_it_turns_out_to_be_elsewhere(
    axis: int, turned_deg: float, *, serves: bool
) -> None:
    turn = so3.exp(np.radians(turned_deg) * np.eye(3)[axis])
    assert PathMatching(LOOKS_DOWN, tuple).serves(turn @ LOOKS_DOWN) is serves
