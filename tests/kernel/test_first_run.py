"""From an empty machine to a unit that `gaiteyes check` calls fit, by the commands of docs/hardware.md.

The devices are this machine's own; what a person does by hand while a unit is calibrated is not: the file that
`gaiteyes calibrate` would have made is put in its place. The machine is too slow for a judgement of rates.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daemon.config import load_configuration
from tests.kernel import loopback
from tests.kernel.wearable import Wearable

PROJECT = Path(__file__).parents[2]
LIMIT_S = 240.0
DATA_SHEET = ("--baseline-mm", "120", "--view-deg", "85")
TOO_SLOW_HERE = {"IMU stream", "camera stream", "camera stamps"}


def gaiteyes(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command as a person does, in a folder of the unit."""
    command = [sys.executable, "-m", "cli.main", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False
    )


def checked(folder: Path) -> list[dict[str, Any]]:
    """Return what `gaiteyes check` finds."""
    done = gaiteyes(folder, "check", "--json", "found.json")
    assert done.returncode in (0, 1), done.stderr
    found: list[dict[str, Any]] = json.loads((folder / "found.json").read_bytes())
    print(*found, sep="\n")
    return found


def faults(found: list[dict[str, Any]]) -> set[str]:
    """Return what is faulty, but for what this machine is too slow for."""
    return {each["subject"] for each in found if each["verdict"] == "fault"} - TOO_SLOW_HERE


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("unit")


@pytest.fixture(scope="module")
def wearable() -> Iterator[Wearable]:
    made = Wearable()
    yield made
    made.close()


def test_on_an_empty_machine_each_line_says_what_to_do(folder: Path) -> None:
    found = checked(folder)
    assert faults(found) == {"configuration", "calibration", "IMU", "camera", "CAN"}
    assert all(each["next"] for each in found if each["verdict"] != "fine")
    told = {each["subject"]: each["next"] for each in found}
    assert told["CAN"].startswith("sudo ip link set can0 up type can bitrate")  # a controller is there, but down
    done = gaiteyes(folder, "run")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "`gaiteyes init` finds the devices" in done.stderr


def test_what_is_plugged_in_is_found_and_named(folder: Path, wearable: Wearable) -> None:
    done = gaiteyes(folder, "init")
    assert done.returncode == 2, done.stdout
    assert "its data sheet tells --baseline-mm and --view-deg" in done.stderr
    done = gaiteyes(folder, "init", *DATA_SHEET)
    assert done.returncode == 0, done.stderr
    made = load_configuration(folder / "gaiteyes.toml")
    assert (made.imu.bus, made.imu.address) == (wearable.chip.bus_number, 0x68)
    assert Path(made.camera.device).resolve() == Path(loopback.NODE)
    assert made.can.interface.value == "socketcan"


def test_a_nominal_unit_is_not_fit_to_be_worn(folder: Path, wearable: Wearable) -> None:
    found = checked(folder)
    assert faults(found) == {"calibration"}
    told = {each["seen"]: each["next"] for each in found if each["subject"] == "calibration"}
    assert told["not fit to be worn: camera to IMU ± 3.0°"] == "gaiteyes calibrate mount"
    assert {"IMU self-test", "IMU at rest", "left eye", "right eye", "CAN"} <= {each["subject"] for each in found}


def test_a_calibrated_one_is_and_runs(folder: Path, wearable: Wearable) -> None:
    wearable.write_calibration(folder / "calibration.yaml")
    assert faults(checked(folder)) == set()
    done = gaiteyes(folder, "run", "--seconds", "8", "--json", "run.json")
    assert done.returncode == 0, done.stderr
    assert json.loads((folder / "run.json").read_bytes())["health"]["frames"] > 0
