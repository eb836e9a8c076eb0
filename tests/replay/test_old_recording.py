"""A recording made while the interface had version 1 is read and replayed as ever: what changed is what comes out.

Its pictures are of 8 × 6 px: kept for its form, not for the ground in it.
"""

import gzip
import json
import math
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader

import gaiteyes
from messages import Attitude, GroundPlane, PropagatedGround
from messages.codec import decode

OLD = Path(__file__).with_name("recording_of_version_1.mcap.gz")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "old.mcap"
    path.write_bytes(gzip.decompress(OLD.read_bytes()))
    return path


def recorded(path: Path) -> Counter[str]:
    with path.open("rb") as file:
        return Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())


def test_it_is_replayed_with_the_messages_of_today(recording: Path) -> None:
    inputs, told = recorded(recording), Counter(type(each) for each in gaiteyes.replay(recording))
    assert (inputs["frame/left"], inputs["propagated_ground"]) == (4, 0)
    assert told[GroundPlane] == inputs["frame/left"]
    assert told[PropagatedGround] == told[Attitude] > 20


def test_what_it_holds_of_estimates_still_has_its_meaning_in_its_type(recording: Path) -> None:
    with recording.open("rb") as file:
        lines = [m.data for _, channel, m in make_reader(file).iter_messages() if channel.topic == "ground"]
    grounds = [decode(line, GroundPlane) for line in lines]
    assert len(grounds) == 4
    for ground, line in zip(grounds, lines, strict=True):
        assert ground.reason.value == json.loads(line)["reason"] == "low_texture"
        assert math.isnan(ground.height_m)
