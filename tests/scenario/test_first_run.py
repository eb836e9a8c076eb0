"""From an empty folder to a unit that `gaiteyes check` calls fit, by the README's own commands in the README's order.

The machine's devices are emulated, without a CAN bus: nodes that are found, a chip behind its registers that a person
lays on its faces, a camera before which a board is held. The walks are recordings of the rig, each made with the
calibration that the file has by then. All belongs to one unit, whose true values nobody is told.
"""

import dataclasses
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.files import format_calibration, load_calibration
from calib.stereo.board import Board
from cli import devices as hardware
from cli.main import app
from daemon.recorder import Recorder
from drivers.discovery import devices
from drivers.imu.mpu6050 import Mpu6050
from messages import Calibration
from messages.constants import STANDARD_GRAVITY_MPS2
from perception import so3
from sim_rig.camera.shutter import Shutter
from sim_rig.unit import Unit, draw_unit
from sim_rig.walk.legs import Stand, Walk
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer
from tests.bench.handled import BoardCamera, driven_imu, laid_on_its_faces, lying
from tests.bench.plugged import Plugged
from tests.bench.quiet_devices import GreyCamera
from tests.bench.recorded import INFO

README = Path(__file__).parents[2] / "README.md"
SEED = 1007
START_NS = 10_000_000_000
HURRY = 10.0
SENSOR_ERRORS_MPS2 = 2e-3 * STANDARD_GRAVITY_MPS2


def commands_of_the_readme() -> list[list[str]]:
    """Return the words of each command of the README's "On hardware", up to and with `check`."""
    text = README.read_text(encoding="utf-8")
    block = re.search(r"## On hardware\n.*?```sh\n(.*?)```", text, re.DOTALL)
    assert block is not None
    words = [shlex.split(line, comments=True)[1:] for line in block[1].splitlines() if line.startswith("gaiteyes")]
    return words[: next(k for k, each in enumerate(words) if each[0] == "check") + 1]


@pytest.fixture
def unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Unit:
    """Return a unit whose devices are plugged into an emulated machine; the folder is empty."""
    unit, machine = draw_unit(SEED), Plugged(tmp_path / "machine")
    machine.imu(1)
    machine.camera("ZED: ZED")
    monkeypatch.setattr(devices, "find_devices", machine.find)
    (tmp_path / "unit").mkdir()
    monkeypatch.chdir(tmp_path / "unit")
    return unit


def run(*words: str) -> int:
    """Run a command in this process; return its exit code."""
    return int(app([*words], standalone_mode=False) or 0)


def faults() -> set[str]:
    """Return what `check` has called faults."""
    found = json.loads(Path("found.json").read_bytes())
    return {each["seen"].removeprefix("not fit to be worn: ") for each in found if each["verdict"] == "fault"}


def recorded(path: Path, seconds: float, legs: tuple[Any, ...]) -> Path:
    """Record what the unit sees on a walk, with the calibration that its file has now."""
    world = WorldBuilder().level(20.0, "concrete").level(60.0, "asphalt").build()
    wearer = SimulatedWearer(SEED, Scenario("there", "level ground, with stops", world, legs), START_NS)
    known = load_calibration(Path("calibration.yaml"))
    assert isinstance(known, Calibration)
    wearer.calibration = known
    wearer.shutter = Shutter(wearer.unit.stereo, known.stereo, SEED, START_NS)
    info = dataclasses.replace(INFO, calibration_text=format_calibration(known), configuration_text="device = 'bench'")
    recorder = Recorder(path, info)
    for message in wearer.offline_inputs(seconds):
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()
    return path


@pytest.mark.long
def test_six_commands_lead_to_a_unit_that_is_fit(unit: Unit, monkeypatch: pytest.MonkeyPatch) -> None:
    commands = commands_of_the_readme()
    assert [words[: 1 + (words[0] == "calibrate")] for words in commands] == [
        ["init"],
        ["calibrate", "imu"],
        ["calibrate", "stereo"],
        ["calibrate", "mount"],
        ["calibrate", "wearer"],
        ["check"],
    ]
    init, imu, stereo, mount, wearer, check = commands

    def plugged(device: Mpu6050, camera: Any) -> None:
        monkeypatch.setattr(hardware, "build_imu", lambda _settings: device)
        monkeypatch.setattr(hardware, "camera_opener", lambda _settings, _calibration: lambda: camera)

    plugged(driven_imu(unit, lying), GreyCamera())
    assert run(*init[:1]) == 0  # without the maker's file
    assert run(*check, "--seconds", "1", "--json", "found.json") == 1
    assert faults() == {
        "accelerometer ± 61 mg, 3.5° of tilt",
        "camera to IMU ± 3.0°",
        "distances ± 20.4 %",
        "rows of the eyes ± 7.0 px",
    }

    plugged(driven_imu(unit, laid_on_its_faces, HURRY), GreyCamera())
    assert run(*imu, "--seconds", "60", "--gravity", str(STANDARD_GRAVITY_MPS2), "--json", "told.json") == 0
    assert json.loads(Path("told.json").read_bytes())["not_told"] == []
    made = load_calibration(Path("calibration.yaml"))
    assert np.abs(np.array(made.imu.sf_bias_mps2) - unit.chip.sf_bias_mps2).max() < SENSOR_ERRORS_MPS2

    board = re.search(r"(\d+)x(\d+)", stereo[stereo.index("--board") + 1])
    assert board is not None
    square_m = 1e-3 * float(stereo[stereo.index("--square-mm") + 1])
    plugged(
        driven_imu(unit, lying),
        BoardCamera(unit, Board(int(board[1]), int(board[2]), square_m)),
    )
    assert run(*stereo, "--seconds", "1200") == 0
    made = load_calibration(Path("calibration.yaml"))
    assert isinstance(made, Calibration)
    assert made.imu.sf_bias_mps2 != (0.0, 0.0, 0.0)  # the pair alone was replaced
    assert abs(made.stereo.X_RL.p_m[0] / unit.stereo.X_RL.p_m[0] - 1.0) < 0.005

    walk = (Stand(3.0), Walk(17.0, 1.2, 1.8), Stand(2.0), Walk(33.0, 1.3, 1.9), Stand(2.0), Walk(60.0, 1.2, 1.8))
    assert run(*mount, "--from", str(recorded(Path("walk.mcap"), 42.0, walk))) == 0
    Path("walk.mcap").unlink()
    made = load_calibration(Path("calibration.yaml"))
    # B may have turned with the accelerometer's cross-axis terms: how the camera stands to the chip's axes counts
    by_file = np.array(made.X_BE.R).T @ np.array(made.imu.sf_matrix)
    by_truth = np.array(unit.X_BL.R).T @ np.linalg.inv(unit.chip.sf_matrix)
    assert np.degrees(np.abs(so3.log(by_file @ np.linalg.inv(by_truth)))).max() < 0.15

    there = (Stand(3.0), Walk(9.0, 1.2, 1.8), Stand(4.0), Walk(12.0, 1.2, 1.8))
    assert run(*wearer, "--from", str(recorded(Path("walk.mcap"), 14.0, there))) == 0

    plugged(driven_imu(unit, lying), GreyCamera())
    assert run(*check, "--seconds", "1", "--json", "found.json") == 0, faults()
    assert faults() == set()
