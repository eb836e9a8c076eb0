"""Hidden effects of the IMU: drawn where the finder cannot see them, found by a fresh process in files alone."""

import secrets
from functools import partial
from pathlib import Path

from sim_rig.hidden import imu as hidden
from sim_rig.hidden.case import Case, Kind
from tests.hidden_effect.trials import drawn, judged, prevails


def test_what_is_hidden_is_named_what_is_not_is_not_and_what_nobody_knows_is_unknown(tmp_path: Path) -> None:
    assert prevails(hidden, partial(drawn, "imu", hidden, hidden.EFFECTS, hidden.OUTSIDE), tmp_path)


def test_an_effect_is_told_with_its_size(tmp_path: Path) -> None:
    case = Case("imu", 1000 + secrets.randbelow(1 << 30), Kind.SINGLE, ("gyro_scale",))
    print(case)
    truth, verdict = judged(hidden, case, tmp_path)
    print(truth, verdict)
    told = next(cause for cause in verdict.causes if cause.name == "gyro_scale").parameters
    for name, value in truth.causes[0].parameters.items():
        quantity = told[name]
        assert quantity.value is not None
        assert quantity.low is not None
        assert quantity.high is not None
        assert abs(quantity.value - value) < max(1.5 * (quantity.high - quantity.low), 0.05 * abs(value))


def test_two_effects_at_once_are_both_named(tmp_path: Path) -> None:
    case = Case("imu", 1000 + secrets.randbelow(1 << 30), Kind.PAIR, ("frame_rotation", "gyro_scale"))
    print(case)
    truth, verdict = judged(hidden, case, tmp_path)
    print(truth, verdict)
    assert {"frame_rotation", "gyro_scale"} <= {cause.name for cause in verdict.causes}
