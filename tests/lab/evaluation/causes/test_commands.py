"""`gaiteyes evaluate static` and `walking`: on the rig and on a recording of it, in front of a person and a program."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from calib.files import format_calibration
from cli.main import app
from daemon.recorder import Recorder
from lab.evaluation.causes.names import DEPTH, EXTRINSIC, IMU, ORIENTATION, SYNCHRONISATION
from messages import Frame, UserError
from perception.ground.foothold import FootholdSettings
from sim_rig.depth_wearer import DepthWearer
from sim_rig.walk.scenario import scenario
from tests.bench.data_folder import shared_data
from tests.bench.html_page import read
from tests.bench.recorded import INFO


def evaluate(*arguments: object) -> None:
    app(["evaluate", *map(str, arguments)], standalone_mode=False)


def causes(path: Path) -> dict[str, dict[str, Any]]:
    return {each["name"]: each for each in json.loads(path.read_bytes())["causes"]}


@pytest.mark.long
def test_a_still_depth_camera_is_told_by_cause(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("skimage")
    pytest.importorskip("matplotlib")
    facts, plot, html = (tmp_path / name for name in ("facts.json", "causes.png", "errors.html"))
    arguments = ("static", "--camera", "depth", "--seeds", 3, "--slopes", "-6", "--seconds", 2.2)
    evaluate(*arguments, "--json", facts, "--plot", plot, "--html", html)
    found = causes(facts)
    assert {"as measured", IMU, ORIENTATION, DEPTH, EXTRINSIC} == set(found)
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "true attitude" in capsys.readouterr().out
    page = read(html)
    assert "its true bias and scale" in page
    assert html.read_text(encoding="utf-8").count("<svg") == 3
    for each in found.values():
        assert each["frames"] > 10
    # with the true plane, what is left comes from the attitude alone, and the height is right to its cosine
    assert found[DEPTH]["left_height_mm"] < 1.0 < found["as measured"]["left_height_mm"] + 1.0
    assert found[ORIENTATION]["part_sagittal_deg"] > 0.0


@pytest.mark.long
def test_a_walking_pair_is_told_by_cause(tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    facts = tmp_path / "facts.json"
    evaluate("walking", "--seeds", 3, "--seconds", 5.0, "--json", facts)
    found = causes(facts)
    assert found[SYNCHRONISATION]["frames"] > 40
    assert 0.0 < found["motion blur"]["part_sagittal_deg"] < found["as measured"]["left_sagittal_deg"]


def test_a_recording_with_truth_is_told_by_cause(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("skimage")
    pytest.importorskip("matplotlib")
    wearer = DepthWearer(5, scenario("standing"), 10_000_000_000)
    calibration = format_calibration(wearer.calibration)
    info = dataclasses.replace(INFO, calibration_text=calibration, configuration_text="device = 'bench'\n")
    recorder = Recorder(tmp_path / "walk.mcap", info)
    foothold = FootholdSettings()
    for message in wearer.offline_inputs(2.0):
        recorder.offer(message)
        if isinstance(message, Frame):
            recorder.offer(wearer.truth(message.header.t_exposure_ns, foothold.ahead_m, foothold.half_length_m))
        recorder.drain(timeout_s=0.0)
    recorder.close()
    evaluate("static", tmp_path / "walk.mcap", "--json", tmp_path / "facts.json", "--html", tmp_path / "page.html")
    page = read(tmp_path / "page.html")
    assert f"{tmp_path / 'walk.mcap'}, " in page
    assert "Explained best by a camera turned by" in page
    found = causes(tmp_path / "facts.json")
    assert {"as measured", IMU, ORIENTATION, DEPTH, EXTRINSIC} == set(found)  # who stands tells nothing of stamps
    assert found[ORIENTATION]["frames"] >= 10
    assert found[EXTRINSIC]["part_height_mm"] == pytest.approx(0.0, abs=1e-9)
    assert "Explained best by a camera turned by" in capsys.readouterr().out


@pytest.mark.long
def test_a_real_folder_with_truth_is_told_by_cause(tmp_path: Path) -> None:
    evaluate("static", shared_data("euroc_v1_01_easy"), "--json", tmp_path / "facts.json")
    found = causes(tmp_path / "facts.json")
    assert found[ORIENTATION]["left_frontal_deg"] < 0.5 < found["as measured"]["left_frontal_deg"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("static", "--slopes", "steep"), r"--slopes steep: expected degrees such as -8,0,8"),
        (("static", "--slopes", "40"), r"--slopes 40: allowed are −15 to 15 degrees"),
        (("static", "--camera", "eye"), r"camera is 'eye', known are stereo, depth"),
        (("walking", "--scenario", "moon"), r"scenario is 'moon', known are"),
        (("walking", "--seeds", "x"), r"--seeds x: expected numbers"),
        (("static", "nowhere.mcap"), r"nowhere.mcap: No such file"),
    ],
)
def test_a_mistake_is_one_line(arguments: tuple[object, ...], line: str) -> None:
    pytest.importorskip("skimage")
    with pytest.raises(UserError, match=line) as told:
        evaluate(*arguments)
    assert "\n" not in str(told.value)


def test_a_report_into_no_folder_is_one_line_before_the_long_work(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    with pytest.raises(UserError, match=r"--html .*absent/page\.html: its folder does not exist"):
        evaluate("static", "--html", tmp_path / "absent" / "page.html")
