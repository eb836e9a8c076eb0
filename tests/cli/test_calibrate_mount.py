"""`gaiteyes calibrate mount`: what it writes and says of what a walk has told; the walk itself is told."""

import dataclasses
import json
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.files import format_calibration, load_calibration, save_calibration
from calib.fitness import shortcomings
from calib.mount import LEAST_S, Found
from calib.strict_yaml import CalibrationError
from cli import calibrate_mount
from cli.main import app
from daemon.recorder import Recorder
from messages import Calibration, Residual
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from sim_rig.unit import RESIDUAL, draw_unit
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.bench.recorded import INFO

TOLD_PERCENT = 0.4
UNSURE_OF_DISTANCES = msgspec.structs.replace(RESIDUAL, toe_in_rad=math.radians(0.2), baseline=1e-3)


def mount(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, residual: Residual) -> tuple[Calibration, Calibration]:
    """Return the calibration before and after a walk that tells nothing but a scale."""
    before = msgspec.structs.replace(draw_unit(7).exact_calibration(), residual=residual)
    path = tmp_path / "unit.yaml"
    save_calibration(path, before)
    sure = MountingErrors((0.0, 0.0, 0.0), 1e-8 * np.eye(3), 0.0, 1e-8, 0.01 * TOLD_PERCENT, 1e-3**2)
    sensors = SensorErrors((0.0, 0.0, 0.0), (1e-8,) * 3, (0.0, 0.0, 0.0), (1e-6,) * 3, 0.0, 1e-6)
    monkeypatch.setattr(calibrate_mount, "_walked", lambda *_: Found(sure, sensors, sure, 31.0))
    arguments = [path, "--from", tmp_path / "walk.mcap", "--json", tmp_path / "facts.json"]
    app(["calibrate", "mount", *map(str, arguments)], standalone_mode=False)
    after = load_calibration(path)
    assert isinstance(after, Calibration)
    return before, after


def test_the_scale_is_written_sealed_and_what_check_judges_by(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = mount(tmp_path, monkeypatch, UNSURE_OF_DISTANCES)
    assert after.stereo.X_RL != before.stereo.X_RL
    assert after.id != before.id
    assert any("distances" in each.what for each in shortcomings(before))
    assert not any("distances" in each.what for each in shortcomings(after))
    said = capsys.readouterr().out
    assert "of it the baseline, too long by" in said
    assert "A walk tells the scale of distances, not a baseline from a toe-in" in said
    facts = json.loads((tmp_path / "facts.json").read_bytes())
    assert facts["distance_scale"] == pytest.approx(0.01 * TOLD_PERCENT)
    assert facts["pair"]["toe_in_rad"] < 0.0 < facts["pair"]["toe_in_std_rad"]


def test_a_scale_that_the_file_does_not_explain_is_left_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sure_of_distances = msgspec.structs.replace(RESIDUAL, toe_in_rad=1e-6, baseline=1e-4)
    before, after = mount(tmp_path, monkeypatch, sure_of_distances)
    assert after.stereo.X_RL == before.stereo.X_RL
    assert "Distances stay as they are" in capsys.readouterr().out
    assert json.loads((tmp_path / "facts.json").read_bytes())["pair"] is None


@pytest.mark.long
def test_a_walk_without_a_picture_tells_no_mounting_and_the_file_stays(tmp_path: Path) -> None:
    wearer = SimulatedWearer(7, scenario("standing"), 10_000_000_000)
    recording, file = tmp_path / "walk.mcap", tmp_path / "unit.yaml"
    save_calibration(file, wearer.calibration)
    text = format_calibration(wearer.calibration)
    recorder = Recorder(
        recording, dataclasses.replace(INFO, calibration_text=text, configuration_text="device = 'bench'\n")
    )
    for sample in wearer.offline_samples(LEAST_S + 1.0):
        recorder.offer(sample)
        recorder.drain(timeout_s=0.0)
    recorder.close()
    with pytest.raises(
        CalibrationError, match=r"walk\.mcap: refused: the walk tells the camera's angles .* allowed 0\.1°"
    ):
        app(["calibrate", "mount", str(file), "--from", str(recording)], standalone_mode=False)
    assert load_calibration(file) == wearer.calibration
