"""`gaiteyes calibrate`: what it writes, and what it refuses."""

import dataclasses
import json
from pathlib import Path
from typing import NoReturn

import msgspec
import pytest

from calib.files import format_calibration, load_calibration, save_calibration
from calib.imu.log import ImuLog
from cli import devices
from cli.main import app
from daemon.recorder import Recorder
from messages import ImuSample, UserError, WearerHeight
from sim_rig.camera.depth_unit import draw_depth_unit
from sim_rig.unit import draw_unit
from sim_rig.walk.legs import Stand, Walk
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer
from tests.bench.quiet_devices import GreyCamera, QuietImu
from tests.bench.recorded import INFO, imu
from tests.bench.zed_conf_file import conf, sections


def calibrate_zed(*arguments: object) -> None:
    app(["calibrate", "zed", *map(str, arguments)], standalone_mode=False)


def test_factory_values_alone_make_a_file_that_says_what_is_nominal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, facts = tmp_path / "new.yaml", tmp_path / "facts.json"
    zed = conf(tmp_path, sections())
    calibrate_zed(zed, "--out", out, "--json", facts)
    made = load_calibration(out)
    assert made.unit == "SN1234 HD, rest nominal"
    assert json.loads(facts.read_bytes())["id"] == made.id
    assert "calibrate them before anybody walks with this unit" in capsys.readouterr().out

    with pytest.raises(
        UserError, match=r"new\.yaml: exists already; --into .*new\.yaml changes its pair, --out names another file"
    ):
        calibrate_zed(zed, "--out", out)
    assert load_calibration(out) == made


def test_a_known_unit_gets_the_pair_and_keeps_the_rest(tmp_path: Path) -> None:
    known = draw_unit(3).exact_calibration()
    path = tmp_path / "unit.yaml"
    save_calibration(path, known)
    calibrate_zed(conf(tmp_path, sections()), "--into", path)
    made = load_calibration(path)
    assert made.imu == known.imu
    assert made.camera.lens.fx_px == sections()["LEFT_CAM_HD"]["fx"]


def test_a_file_edited_by_hand_is_shown_and_sealed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, facts = tmp_path / "unit.yaml", tmp_path / "facts.json"
    calibration = draw_depth_unit(1, perfect_calibration=True)[1]
    path.write_text(format_calibration(calibration), encoding="utf-8")
    with pytest.raises(UserError, match="has no seal"):
        load_calibration(path)
    app(["calibrate", "seal", str(path), "--json", str(facts)], standalone_mode=False)
    assert load_calibration(path) == calibration
    assert json.loads(facts.read_bytes())["id"] == calibration.id
    assert "Compare these values with what was meant" in capsys.readouterr().out


def test_a_depth_cameras_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "depth.yaml"
    save_calibration(path, draw_depth_unit(1, perfect_calibration=True)[1])
    with pytest.raises(UserError, match=r"--into .*depth\.yaml: is of a depth camera"):
        calibrate_zed(conf(tmp_path, sections()), "--into", path, "--out", tmp_path / "out.yaml")
    assert not (tmp_path / "out.yaml").exists()


def recorded_walk(folder: Path, seconds: float) -> tuple[Path, Path, SimulatedWearer]:
    """Return a recording of a unit whose wearer stands, walks and stands, its calibration file, and the wearer."""
    world = WorldBuilder().level(12.0, "concrete").build()
    legs = (Stand(3.0), Walk(9.0, 1.2, 1.8), Stand(4.0), Walk(12.0, 1.2, 1.8))
    wearer = SimulatedWearer(7, Scenario("there", "standing, walking, standing", world, legs), 10_000_000_000)
    recording, file = folder / "walk.mcap", folder / "unit.yaml"
    save_calibration(file, wearer.calibration)
    info = dataclasses.replace(
        INFO, calibration_text=format_calibration(wearer.calibration), configuration_text="device = 'bench'\n"
    )
    recorder = Recorder(recording, info)
    for message in wearer.offline_inputs(seconds):
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()
    assert recorder.dropped == 0
    return recording, file, wearer


def calibrate_wearer(*arguments: object) -> None:
    app(["calibrate", "wearer", *map(str, arguments)], standalone_mode=False)


@pytest.mark.long
def test_the_wearers_height_is_measured_on_a_recording_and_may_be_measured_again(tmp_path: Path) -> None:
    recording, file, wearer = recorded_walk(tmp_path, 14.0)
    facts = tmp_path / "facts.json"
    calibrate_wearer(file, "--from", recording, "--json", facts)
    made = load_calibration(file)
    assert isinstance(made.wearer, WearerHeight)
    true_m = wearer.truth(10_000_000_000 + 2_000_000_000).height_m
    assert abs(made.wearer.camera_height_m - true_m) < 3.0 * made.wearer.std_m
    assert made.wearer.std_m < 0.015
    assert msgspec.structs.replace(made, wearer=msgspec.UNSET) == wearer.calibration
    assert json.loads(facts.read_bytes())["wearer"] == msgspec.to_builtins(made.wearer)
    calibrate_wearer(file, "--from", recording)
    assert load_calibration(file) == made


def test_what_shows_no_wearer_leaves_the_file_as_it_is(tmp_path: Path) -> None:
    recording, file, wearer = recorded_walk(tmp_path, 0.5)
    with pytest.raises(UserError, match=r"walk\.mcap: 0 of \d+ frames show valid ground and motion, allowed from 150"):
        calibrate_wearer(file, "--from", recording)
    assert load_calibration(file) == wearer.calibration

    other = draw_unit(8).exact_calibration()
    save_calibration(file, other)
    with pytest.raises(UserError, match=r"recorded with calibration .* of unit 'rig-7', .*unit\.yaml is .* 'rig-8'"):
        calibrate_wearer(file, "--from", recording)
    save_calibration(file, draw_depth_unit(1, perfect_calibration=True)[1])
    with pytest.raises(UserError, match=r"unit\.yaml: is of a depth camera"):
        calibrate_wearer(file, "--from", recording)


@pytest.mark.long
def test_on_devices_that_show_nothing_the_file_stays_and_the_devices_are_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, config = tmp_path / "unit.yaml", tmp_path / "gaiteyes.toml"
    known = draw_unit(7).exact_calibration()
    save_calibration(file, known)
    config.write_text("device = 'bench'\n", encoding="utf-8")
    imu, camera = QuietImu(), GreyCamera()
    monkeypatch.setattr(QuietImu, "open", lambda _imu: None, raising=False)
    monkeypatch.setattr(devices, "build_imu", lambda _settings: imu)
    monkeypatch.setattr(devices, "camera_opener", lambda _settings, _calibration: lambda: camera)
    with pytest.raises(UserError, match=r"gaiteyes\.toml: 0 of \d+ frames show valid ground and motion"):
        calibrate_wearer(file, "--config", config, "--seconds", 10)
    assert load_calibration(file) == known
    assert imu.closed
    assert camera.closed


class _Given:
    """An IMU that gives its samples half a second at a time, at once, and then falls silent."""

    def __init__(self, seconds: float) -> None:
        self._left = [imu(k, 10_000_000 * k) for k in range(round(100 * seconds) + 1)]

    def open(self) -> None:
        """Do nothing: it is there."""

    def read(self, timeout_s: float) -> list[ImuSample]:
        del timeout_s
        given, self._left = self._left[:50], self._left[50:]
        return given

    def close(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize(("there_s", "measured_s"), [(60.0, 30.0), (20.0, 20.0)])
def test_an_imu_is_measured_for_so_many_of_its_own_seconds_or_until_it_is_silent(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    there_s: float,
    measured_s: float,
) -> None:
    """On a busy host, whose clock runs on, nothing less is measured."""
    config = tmp_path / "gaiteyes.toml"
    config.write_text("device = 'bench'\n", encoding="utf-8")
    logs = list[ImuLog]()
    monkeypatch.setattr(devices, "build_imu", lambda _settings: _Given(there_s))

    def kept(found: list[ImuLog], *_: object, **__: object) -> NoReturn:
        logs.extend(found)
        raise UserError("enough")

    monkeypatch.setattr("calib.imu.fit.fit_imu", kept)
    with pytest.raises(UserError, match="enough"):
        app(["calibrate", "imu", "--config", str(config), "--seconds", "30"], standalone_mode=False)
    (log,) = logs
    assert log.t_s[-1] - log.t_s[0] == pytest.approx(measured_s, abs=0.5)
    assert ("the IMU fell silent after 20 of 30 s" in capsys.readouterr().out) is (measured_s < 30.0)


def test_a_missing_recording_or_device_is_one_line(tmp_path: Path) -> None:
    file, config = tmp_path / "unit.yaml", tmp_path / "gaiteyes.toml"
    save_calibration(file, draw_unit(7).exact_calibration())
    with pytest.raises(UserError, match=r"none\.mcap"):
        calibrate_wearer(file, "--from", tmp_path / "none.mcap")
    config.write_text("[imu]\nbus = 254\n", encoding="utf-8")
    with pytest.raises(UserError, match=r"254.*; `gaiteyes check` looks at each device and says what to do"):
        calibrate_wearer(file, "--config", config)
    with pytest.raises(UserError, match=r"254.*; `gaiteyes check` looks at each device and says what to do"):
        app(["calibrate", "imu", str(file), "--config", str(config)], standalone_mode=False)
