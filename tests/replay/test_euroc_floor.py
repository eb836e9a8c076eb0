"""A real recording over a real floor, with motion capture as truth."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from daemon.pipeline import Pipeline
from daemon.replay import replay
from daemon.replay_source import open_source
from lab.evaluation.floor import score_floor
from lab.faults.deformed_view import turned_eye
from messages import Calibration, GroundPlane, Reason, Status, StereoFrame
from perception import so3
from tests.bench.data_folder import shared_data


@pytest.mark.parametrize("deg", [-1.0, 1.5])
def test_with_the_right_eye_rolled_no_plane_is_told(deg: float) -> None:
    source = open_source(shared_data("euroc_v1_01_easy"), None)
    assert isinstance(source.calibration, Calibration)
    rolled = turned_eye(source.calibration.stereo, so3.exp(np.radians([0.0, 0.0, deg])), left=False)
    pipeline, grounds = Pipeline(source.calibration, source.configuration.foothold), list[GroundPlane]()
    for message in source.inputs():
        if isinstance(message, StereoFrame):
            left, right = rolled((message.left, message.right))
            message = msgspec.structs.replace(message, left=left, right=right)
        grounds += [told for told in pipeline.step(message) if isinstance(told, GroundPlane) and told.frame_seq >= 0]
    assert len(grounds) == 10
    assert {ground.status for ground in grounds} == {Status.INVALID}
    assert {ground.reason for ground in grounds[1:]} == {Reason.EYES_MISALIGNED}


@pytest.mark.long
def test_the_floor_below_the_vehicle_is_level_and_as_far_as_motion_capture_says(tmp_path: Path) -> None:
    source = open_source(shared_data("euroc_v1_01_easy"), None)
    foothold = source.configuration.foothold
    out = tmp_path / "floor.jsonl"
    replayed = replay(source.inputs(), Pipeline(source.calibration, foothold), out)
    waiting, *confirmed = [ground.status for ground in replayed.grounds]
    assert waiting is Status.INVALID
    assert confirmed == [Status.VALID] * 9
    assert source.poses is not None
    frames = (message for message in source.inputs() if isinstance(message, StereoFrame))
    scores = score_floor(frames, replayed.grounds, source.poses, source.calibration, foothold)
    assert scores["true attitude"].angle_rms_deg <= 0.5
    assert scores["IMU's attitude"].angle_rms_deg <= 1.3
    assert abs(scores["true attitude"].height_error_mean_mm) <= 15.0
    lines = [json.loads(line) for line in out.read_bytes().splitlines()]
    assert sum(line["topic"] == "ground" for line in lines) == 10
