"""`gaiteyes init`: what it writes on which machine, and what it refuses."""

import json
from pathlib import Path

import msgspec
import pytest

from calib.files import load_calibration, save_calibration
from calib.seal import sealed
from cli.main import app
from daemon.config import load_configuration
from drivers.can.settings import CanInterface
from drivers.discovery import devices
from messages import Calibration, DepthUnitCalibration, UserError
from sim_rig.camera.v4l2_node import Mode
from sim_rig.unit import draw_unit
from tests.bench.plugged import Plugged
from tests.bench.zed_conf_file import conf, sections


@pytest.fixture
def plugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plugged:
    """Return the machine that `gaiteyes init` finds itself on, in a folder of its own."""
    machine = Plugged(tmp_path / "machine")
    monkeypatch.setattr(devices, "find_devices", machine.find)
    (tmp_path / "unit").mkdir()
    monkeypatch.chdir(tmp_path / "unit")
    return machine


def init(*arguments: object) -> None:
    app(["init", *map(str, arguments)], standalone_mode=False)


def test_a_zed_an_imu_and_a_bus_make_both_files(plugged: Plugged, capsys: pytest.CaptureFixture[str]) -> None:
    plugged.imu(7, 0x69)
    plugged.camera(by_id="usb-STEREOLABS_ZED_2-video-index0")
    plugged.can("can0", up=True)
    init("--data-ready", "/dev/gpiochip0:17", "--json", "facts.json")
    made = load_configuration(Path("gaiteyes.toml"))
    assert (made.imu.bus, made.imu.address, made.imu.data_ready) == (7, 0x69, "/dev/gpiochip0:17")
    assert made.camera.device.endswith("usb-STEREOLABS_ZED_2-video-index0")
    assert (made.can.interface, made.can.channel) == (CanInterface.SOCKETCAN, "can0")
    assert "address = 0x69\n" in Path("gaiteyes.toml").read_text(encoding="utf-8")
    calibration = load_calibration(Path("calibration.yaml"))
    assert isinstance(calibration, Calibration)
    assert (calibration.unit, calibration.stereo.left.width_px) == ("ZED 2, nominal", 1280)
    assert calibration.stereo.X_RL.p_m == (-0.12, 0.0, 0.0)
    assert calibration.stereo.row_time_s * 720 == pytest.approx(1.0 / 60.0)
    assert calibration.stereo.stamp_to_mid_exposure_s == -0.02
    assert json.loads(Path("facts.json").read_bytes())["calibration_id"] == calibration.id
    told = capsys.readouterr().out
    assert "MPU-6050, MPU-6000 or MPU-9150 at 0x69 of /dev/i2c-7" in told
    assert told.endswith("next: gaiteyes check\n")


def test_without_a_camera_there_is_no_calibration_until_it_is_plugged_in(plugged: Plugged) -> None:
    init("--device", "unit-3", "--imu", "1:0x69")
    before = Path("gaiteyes.toml").read_bytes()
    assert not Path("calibration.yaml").exists()
    plugged.camera("ZED-M: ZED-M")
    with pytest.raises(UserError, match="camera /dev/video0: is not there, or is of another kind; ZED-M: ZED-M"):
        init()  # the machine's own node is called otherwise
    init("--force", "--device", "unit-3", "--imu", "1:0x69")
    assert load_calibration(Path("calibration.yaml")).unit == "ZED-M, nominal"
    assert Path("gaiteyes.toml").read_bytes() != before


def test_files_that_are_there_are_kept(plugged: Plugged) -> None:
    plugged.camera()
    init()
    measured = draw_unit(3).exact_calibration()
    save_calibration(Path("calibration.yaml"), measured)
    with pytest.raises(UserError, match=r"gaiteyes\.toml: exists already; `gaiteyes check` looks at what it names"):
        init()
    commented = sealed("# measured on Tuesday\n" + Path("calibration.yaml").read_text(encoding="utf-8"))
    Path("calibration.yaml").write_text(commented, encoding="utf-8")
    init("--force")
    assert load_calibration(Path("calibration.yaml")) == measured
    assert Path("calibration.yaml").read_text(encoding="utf-8") == commented

    Path("calibration.yaml").unlink()
    mine = f"device = 'mine'\n[camera]\ndevice = '{plugged.nodes[0].path}'\n"
    Path("gaiteyes.toml").write_text(mine, encoding="utf-8")
    with pytest.raises(UserError, match="exists already"):
        init("--can", "socketcan:can0")
    init()
    assert load_configuration(Path("gaiteyes.toml")).device == "mine"
    assert load_calibration(Path("calibration.yaml")).unit == "ZED 2, nominal"


def test_the_makers_file_tells_of_the_lenses_without_a_camera(plugged: Plugged, tmp_path: Path) -> None:
    assert plugged.nodes == []
    init("--conf", conf(tmp_path, sections()))
    made = load_calibration(Path("calibration.yaml"))
    assert made.unit == "SN1234 HD, rest nominal"
    assert made.camera.lens.fx_px == sections()["LEFT_CAM_HD"]["fx"]


def test_of_an_unknown_camera_the_data_sheet_is_asked_for_before_anything_is_written(plugged: Plugged) -> None:
    plugged.camera("Eyes", Mode("YUYV", 1504, 480))
    with pytest.raises(UserError, match=r"^Eyes \(side by side, 752x480\) at .*: is not known here; its data"):
        init()
    assert list(Path().iterdir()) == []
    init("--baseline-mm", 65, "--view-deg", 90)
    made = load_calibration(Path("calibration.yaml"))
    assert made.camera.lens.fx_px == pytest.approx(376.0)
    assert made.residual.toe_in_rad > 0.01


def test_a_depth_camera_makes_a_depth_units_calibration(plugged: Plugged) -> None:
    plugged.camera("Depth", Mode("Z16 ", 848, 480))
    init("--baseline-mm", 50, "--view-deg", 87)
    made = load_calibration(Path("calibration.yaml"))
    assert isinstance(made, DepthUnitCalibration)
    assert made.depth.baseline_m == pytest.approx(0.05)


def test_two_cameras_are_named_left_and_right(plugged: Plugged) -> None:
    for _ in range(2):
        plugged.camera("Eye", Mode("GREY", 1280, 720))
    left, right = (node.path for node in plugged.nodes)
    with pytest.raises(UserError, match="two that belong together are named with --left and --right"):
        init("--baseline-mm", 100, "--view-deg", 80)
    with pytest.raises(UserError, match="--left and --right belong together"):
        init("--left", left)
    init("--left", left, "--right", right, "--baseline-mm", 100, "--view-deg", 80)
    made = load_configuration(Path("gaiteyes.toml"))
    assert (made.camera.left, made.camera.right) == (left, right)
    assert isinstance(load_calibration(Path("calibration.yaml")), Calibration)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--imu", "0x68"), "^--imu 0x68: expected BUS:ADDRESS, 1:0x68 say$"),
        (("--imu", "1:0x70"), "gaiteyes init: imu.address is 0x70, allowed a whole number from 0x68 to 0x69"),
        (("--can", "can0"), "CAN 'can0': expected INTERFACE:CHANNEL"),
        (("--camera", "/dev/video7"), "^camera /dev/video7: is not there, or is of another kind; none was found$"),
        (("--device", "a b"), "gaiteyes init: device is 'a b', allowed text like"),
        (("--data-ready", "17"), "gaiteyes init: imu.data_ready is '17', allowed text like"),
        (("--conf", "SN1.conf"), r"^SN1\.conf: No such file"),
        (("--config", "no/gaiteyes.toml"), r"^no/gaiteyes\.toml: No such file or directory$"),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(plugged: Plugged, arguments: tuple[str, ...], line: str) -> None:
    assert msgspec.to_builtins(plugged.find())["cameras"] == []
    with pytest.raises(UserError, match=line):
        init(*arguments)
    assert list(Path().iterdir()) == []
