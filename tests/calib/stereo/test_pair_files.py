"""The pair in the formats of others: out and in again it is the same."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.files import load_calibration, save_calibration
from calib.stereo.pair_files import camchain_text, imu_pose, load_pair, parse_camchain, radtan
from calib.strict_yaml import CalibrationError
from calib.zed_conf import zed_conf_text
from cli.main import app
from lab.evaluation.calibration_trials import seen
from messages import Calibration
from messages.calibration import Lens
from sim_rig.unit import draw_unit
from tests.bench.data_folder import shared_data

UNIT = draw_unit(6).exact_calibration()


def run(*arguments: object) -> None:
    app(["calibrate", *map(str, arguments)], standalone_mode=False)


def close(one: Lens, other: Lens, tolerance_px: float) -> bool:
    x, y = np.meshgrid(np.linspace(-0.85, 0.85, 9), np.linspace(-0.48, 0.48, 7))
    rays = np.stack((x.ravel(), y.ravel(), np.ones(x.size)), axis=-1)
    return bool(np.abs(seen(one, rays) - seen(other, rays)).max() < tolerance_px)


def test_a_camchain_comes_back_with_the_imus_place(tmp_path: Path) -> None:
    text = camchain_text(UNIT)
    pair, pose = parse_camchain(text, "cam.yaml"), imu_pose(text, "cam.yaml")
    assert pair.left.fx_px == UNIT.stereo.left.fx_px
    assert close(pair.left, UNIT.stereo.left, 1e-9)  # its k3 is 0
    assert np.array(pair.X_RL.R) == pytest.approx(np.array(UNIT.stereo.X_RL.R))
    assert pair.X_RL.p_m == pytest.approx(UNIT.stereo.X_RL.p_m)
    assert pose is not None
    assert np.array(pose.R) == pytest.approx(np.array(UNIT.X_BL.R))
    assert pose.p_m == pytest.approx(UNIT.X_BL.p_m)


def test_a_third_radial_term_is_spread_over_the_four_of_kalibr() -> None:
    k1, k2, p1, p2, _ = UNIT.stereo.left.distortion
    lens = msgspec.structs.replace(UNIT.stereo.left, distortion=(k1, k2, p1, p2, 0.01))
    assert len(radtan(lens).distortion) == 4
    assert close(radtan(lens), lens, 1.0)


def test_commands_take_a_unit_out_and_back(tmp_path: Path) -> None:
    unit, conf, chain = (tmp_path / name for name in ("unit.yaml", "SN1.conf", "camchain.yaml"))
    save_calibration(unit, UNIT)
    run("export", unit, "--out", conf)
    run("export", unit, "--out", chain)
    assert np.array(load_pair(conf).X_RL.R) == pytest.approx(np.array(UNIT.stereo.X_RL.R))
    assert load_pair(conf).left.distortion == UNIT.stereo.left.distortion
    assert load_pair(unit) == UNIT.stereo
    with pytest.raises(CalibrationError, match="the pair is 1280x720 px, mode VGA of a ZED 672x376 px"):
        zed_conf_text(UNIT.stereo, "VGA")
    run("kalibr", chain, "--into", unit, "--out", unit)
    made = load_calibration(unit)
    assert isinstance(made, Calibration)
    assert made.imu == UNIT.imu
    assert np.array(made.X_BL.R) == pytest.approx(np.array(UNIT.X_BL.R))


def test_what_is_wrong_with_a_file_is_one_line(tmp_path: Path) -> None:
    text = camchain_text(UNIT)
    for old, new, problem in (
        ("distortion_model: radtan", "distortion_model: equidistant", "cam0.distortion_model is 'equidistant'"),
        ("cam1:", "cam7:", "cam1 is missing"),
        ("T_cn_cnm1", "T_other", r"cam1\.T_cn_cnm1 is missing"),
    ):
        with pytest.raises(CalibrationError, match=problem):
            parse_camchain(text.replace(old, new), "cam.yaml")
    path = tmp_path / "calib.json"
    path.write_text(json.dumps({"cameraData": []}), encoding="utf-8")
    with pytest.raises(CalibrationError, match="no calibration of a DepthAI stereo camera"):
        load_pair(path)


def test_a_real_depthai_file_is_read_in_metres() -> None:
    pair = load_pair(shared_data("oakd_balcony_floor") / "calib.json")
    assert (pair.left.width_px, pair.left.height_px) == (1280, 800)
    assert np.linalg.norm(pair.X_RL.p_m) == pytest.approx(0.0738, abs=0.002)
