"""Scores are what they say: RMS over the valid frames, shares over all after the start."""

import msgspec
import numpy as np
import pytest

from lab.evaluation.score import Scoreboard
from messages import GroundPlane, GroundTruth, Reason, Status

VALID = GroundPlane(
    t_exposure_ns=1,
    frame_seq=1,
    status=Status.VALID,
    reason=Reason.NONE,
    slope_sagittal_rad=0.02,
    slope_frontal_rad=0.0,
    height_m=0.95,
    covariance=(1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4),
    ahead_m=0.7,
    matched_share=0.9,
    inlier_share=0.9,
    disparity_noise_px=0.2,
    calibration_id="x",
)
REFUSED, STARTING = (
    GroundPlane.invalid(t_exposure_ns=1, frame_seq=1, reason=reason, ahead_m=0.7, calibration_id="x")
    for reason in (Reason.NO_FRAME, Reason.STARTING)
)
TRUTH = GroundTruth(
    t_exposure_ns=1,
    slope_sagittal_rad=0.0,
    slope_frontal_rad=0.0,
    height_m=0.96,
    q_WB=(1.0, 0.0, 0.0, 0.0),
    kind="ramp",
    transition=False,
    standing=False,
)


def test_errors_are_of_the_valid_frames_and_shares_of_all_after_the_start() -> None:
    board = Scoreboard()
    for ground in (STARTING, VALID, VALID, VALID, REFUSED):
        board.add(ground, TRUTH)
    score = board.summary()["ramp"]
    assert (score.frames, score.valid_share) == (4, 0.75)
    assert score.slope_sagittal_rms_deg == pytest.approx(np.degrees(0.02))
    assert score.height_rms_mm == pytest.approx(10.0)
    assert score.coverage == pytest.approx(2 / 3)  # the slope is two of its 0.01 off
    assert set(board.summary()) == {"ramp", "all"}


def test_one_slope_in_a_hundred_is_farther_off_than_the_quantile() -> None:
    board = Scoreboard()
    for off_rad in (*np.linspace(-0.01, 0.01, 990), *[0.05] * 10):
        board.add(msgspec.structs.replace(VALID, slope_sagittal_rad=float(off_rad)), TRUTH)
    assert 0.01 <= np.radians(board.summary()["all"].slope_sagittal_p99_deg) <= 0.05
    board.add(msgspec.structs.replace(VALID, slope_sagittal_rad=-0.05), TRUTH)
    assert board.summary()["all"].slope_sagittal_p99_deg == pytest.approx(np.degrees(0.05))


def test_edges_and_standing_have_kinds_of_their_own() -> None:
    board, other = Scoreboard(), Scoreboard()
    board.add(VALID, msgspec.structs.replace(TRUTH, transition=True, standing=True))
    other.add(VALID, msgspec.structs.replace(TRUTH, standing=True))
    board.take(other)
    assert {kind: score.frames for kind, score in board.summary().items()} == {"transition": 1, "standing": 1, "all": 2}


def test_no_valid_frame_is_nan_and_never_zero() -> None:
    board = Scoreboard()
    board.add(REFUSED, TRUTH)
    assert np.isnan(board.summary()["ramp"].height_rms_mm)
    assert board.summary()["ramp"].valid_share == 0.0
