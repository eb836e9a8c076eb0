"""`gaiteyes check`: what it says without files, with nominal ones, and of a unit that is fit."""

import json
from pathlib import Path
from typing import Any

import pytest

from calib.files import save_calibration
from cli import devices as hardware
from cli.main import app
from drivers.discovery import devices
from drivers.protocols import DeviceError
from messages import UnitCalibration, UserError
from sim_rig.unit import draw_unit
from tests.bench.plugged import Plugged
from tests.bench.quiet_devices import GreyCamera, QuietImu


@pytest.fixture
def plugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plugged:
    """Return a machine whose IMU and camera answer in real time once they are plugged in."""
    machine = Plugged(tmp_path / "machine")
    monkeypatch.setattr(devices, "find_devices", machine.find)

    def imu(settings: Any) -> QuietImu:
        if settings.bus not in machine.buses:
            raise DeviceError(f"IMU at I2C address {settings.address:#x}: no such bus")
        return QuietImu()

    def camera(settings: Any, _calibration: UnitCalibration) -> Any:
        if settings.device not in [node.path for node in machine.nodes]:
            raise DeviceError(f"{settings.device}: no such device")
        return GreyCamera

    monkeypatch.setattr(QuietImu, "open", lambda _imu: None, raising=False)
    monkeypatch.setattr(hardware, "build_imu", imu)
    monkeypatch.setattr(hardware, "camera_opener", camera)
    (tmp_path / "unit").mkdir()
    monkeypatch.chdir(tmp_path / "unit")
    return machine


def check() -> tuple[int, dict[str, dict[str, str]]]:
    """Return the exit code and the findings by what was looked at."""
    command = ["check", "--seconds", "1", "--no-self-test", "--json", "found.json"]
    code = app(command, standalone_mode=False)
    found = json.loads(Path("found.json").read_bytes())
    assert all(each["next"] for each in found if each["verdict"] != "fine")
    return code or 0, {each["subject"]: each for each in found}


def test_without_files_what_is_plugged_in_is_looked_at(plugged: Plugged) -> None:
    plugged.imu(4)
    plugged.camera()
    code, found = check()
    assert code == 1
    assert found["configuration"]["next"] == found["calibration"]["next"] == "gaiteyes init"
    assert found["IMU stream"]["verdict"] == found["left eye"]["verdict"] == "fine"


def test_a_nominal_unit_is_not_fit_to_be_worn_and_a_calibrated_one_is(plugged: Plugged) -> None:
    plugged.imu(4)
    plugged.camera()
    app(["init"], standalone_mode=False)
    code, found = check()
    assert code == 1
    assert found["calibration"]["seen"].startswith("time of the pictures")  # the last of several
    assert "configuration" not in found
    save_calibration(Path("calibration.yaml"), draw_unit(1).exact_calibration())
    code, found = check()
    assert code == 0, found
    assert found["calibration"]["verdict"] == "fine"


def test_a_device_that_is_missing_is_told_with_where_it_was_found_instead(plugged: Plugged) -> None:
    Path("gaiteyes.toml").write_text("[imu]\nbus = 1\n", encoding="utf-8")
    plugged.imu(4)
    code, found = check()
    assert code == 1
    assert "at 0x68 of /dev/i2c-4: name it in gaiteyes.toml, or gaiteyes init --force" in found["IMU"]["next"]
    assert found["camera"]["next"].startswith("plug it in; `v4l2-ctl --list-devices`")
    assert found["CAN"]["next"].startswith("a virtual bus ends inside the service")
    assert found["calibration"]["next"] == "gaiteyes init"


def test_a_broken_configuration_is_one_line_and_a_broken_calibration_a_fault(plugged: Plugged) -> None:
    Path("calibration.yaml").write_text("unit: x\n", encoding="utf-8")
    _, found = check()
    assert "has no seal" in found["calibration"]["seen"]
    Path("gaiteyes.toml").write_text("[imu]\nbus = 900\n", encoding="utf-8")
    with pytest.raises(UserError, match=r"gaiteyes\.toml: imu\.bus is 900"):
        check()


def test_a_can_link_that_is_down_is_told_with_the_command_that_starts_it(plugged: Plugged) -> None:
    plugged.can("nocan7", up=False)
    code, found = check()
    assert code == 1
    assert found["CAN"]["next"] == "sudo ip link set nocan7 up type can bitrate 500000 restart-ms 100"
