"""`gaiteyes calibrate zed`: what it writes, and what it refuses to overwrite."""

import json
from pathlib import Path

import pytest

from calib.files import format_calibration, load_calibration, save_calibration
from cli.main import app
from messages import UserError
from sim_rig.camera.depth_unit import draw_depth_unit
from sim_rig.unit import draw_unit
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

    with pytest.raises(UserError, match=r"new\.yaml: exists already; name another file, or change this one with"):
        calibrate_zed(zed, "--out", out)
    assert load_calibration(out) == made


def test_a_known_unit_gets_the_pair_and_keeps_the_rest(tmp_path: Path) -> None:
    known = draw_unit(3).exact_calibration()
    path = tmp_path / "unit.yaml"
    save_calibration(path, known)
    calibrate_zed(conf(tmp_path, sections()), "--into", path, "--out", path)
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
