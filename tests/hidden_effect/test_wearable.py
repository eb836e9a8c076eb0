"""Hidden effects of the wearable: drawn where the finder cannot see them, found by a fresh process in files alone."""

from functools import partial
from pathlib import Path

from sim_rig.hidden import wearable as hidden
from tests.hidden_effect.trials import drawn, prevails


def test_what_is_hidden_is_named_and_what_is_not_is_not(tmp_path: Path) -> None:
    effects = ("time_offset", "acceleration_disturbance", "extrinsic_rotation")
    assert prevails(hidden, partial(drawn, "wearable", hidden, effects, ()), tmp_path)
