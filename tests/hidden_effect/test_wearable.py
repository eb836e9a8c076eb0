"""Hidden effects of the wearable: drawn where the finder cannot see them, found by a fresh process in files alone.

A case is two recordings of pictures to render and to match, some 20 s: so all is drawn from, and little often.
"""

import secrets
from functools import partial
from pathlib import Path

from sim_rig.hidden import wearable as hidden
from sim_rig.hidden.case import Case, Kind
from tests.hidden_effect.trials import drawn, judged, prevails


def test_what_is_hidden_is_named_what_is_not_is_not_and_what_nobody_knows_is_unknown(tmp_path: Path) -> None:
    assert prevails(hidden, partial(drawn, "wearable", hidden, hidden.EFFECTS, hidden.OUTSIDE), tmp_path)


def test_two_effects_at_once_are_both_named(tmp_path: Path) -> None:
    pair = ("extrinsic_rotation", "imu_bias")
    case = Case("wearable", 1000 + secrets.randbelow(1 << 30), Kind.PAIR, pair)
    print(case)
    truth, verdict = judged(hidden, case, tmp_path)
    print(truth, verdict)
    assert set(pair) <= {cause.name for cause in verdict.causes}
