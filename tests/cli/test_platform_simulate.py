"""`gaiteyes platform simulate` and `import`: files a laboratory could have written, and a picture of the run."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cli.main import app
from impedance.recording.recording import PlatformRecording, read_truth
from messages.errors import UserError

pytest.importorskip("mujoco")
pytest.importorskip("matplotlib")


def simulated(*arguments: str) -> None:
    result = CliRunner().invoke(app, ["platform", "simulate", "--seconds", "2", *arguments])
    if result.exception is not None:
        raise result.exception


def test_a_recording_with_picture_and_facts(tmp_path: Path) -> None:
    folder, picture, facts = tmp_path / "run", tmp_path / "run.png", tmp_path / "run.json"
    simulated("--out", str(folder), "--foot", "--seed", "4", "--picture", str(picture), "--json", str(facts))
    recording = PlatformRecording.load(folder)
    assert recording.foot is not None
    assert recording.settings.plate.inertia is not None
    assert read_truth(folder).seed == 4
    assert picture.read_bytes().startswith(b"\x89PNG")
    found = json.loads(facts.read_text())
    assert found["samples"] == 700
    assert found["channels"]["fy, N"]["largest"] > 222.0


def test_a_bare_plate_leaves_its_inertia_open(tmp_path: Path) -> None:
    simulated("--out", str(tmp_path))
    recording = PlatformRecording.load(tmp_path)
    assert recording.foot is None
    assert recording.settings.plate.inertia is None


def test_an_unknown_kind_of_picture_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"run\.bmp: a picture's name ends in"):
        simulated("--out", str(tmp_path), "--picture", str(tmp_path / "run.bmp"))
