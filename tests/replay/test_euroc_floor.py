"""A real recording over a real floor, with motion capture as truth."""

import json
from pathlib import Path

import pytest

from daemon.pipeline import Pipeline
from daemon.replay import replay
from daemon.replay_source import open_source
from lab.evaluation.floor import score_floor
from messages import Status, StereoFrame
from tests.bench.data_folder import shared_data


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
