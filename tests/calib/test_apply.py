"""What the finder found, taken over: the new calibration predicts what the old one did with the effect."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.apply import applied
from calib.files import load_calibration, save_calibration
from calib.strict_yaml import CalibrationError
from cli.main import app
from discrepancy.values import predicted
from lab.hidden.case import Case, Kind
from lab.hidden.wearable.recording import write_recording
from lab.hidden.wearable.walk import draw_nuisance, faultless_scene, faultless_unit
from messages import Calibration, UserError
from messages.arrays import FloatArray
from sim_rig.unit import draw_unit
from systems.wearable.recording import read_files, with_calibration
from systems.wearable.simulation import WearableSimulation

EFFECTS = {
    "extrinsic_rotation": {"x_rad": 0.01, "z_rad": -0.008},
    "time_offset": {"value_s": 0.004},
    "baseline_error": {"share": 0.01},
    "focal_error": {"share": 0.01},
    "toe_in": {"y_rad": 0.001},
    "distortion_residual": {"k1": 0.01},
    "rolling_shutter": {"readout_s": 0.003},
    "imu_bias": {"acc_x_mps2": 0.1, "gyro_y_radps": 0.003},
}
Told = dict[str, dict[str, tuple[float, str]]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    walk = draw_nuisance(Case("wearable", 41, Kind.CLEAN, ()), "fit", 1.0)
    folder = tmp_path_factory.mktemp("wearable") / "clean"
    write_recording(replace(faultless_scene(faultless_unit(41), walk), frames=32), folder)
    return folder


def told(name: str) -> Told:
    return {name: {key: (value, "") for key, value in EFFECTS[name].items()}}


def off(folder: Path, calibration: Calibration, values: dict[str, float]) -> FloatArray:
    simulation = WearableSimulation(with_calibration(read_files(folder), calibration))
    channels = simulation.channels
    assert channels.noise_std is not None
    missed: FloatArray = (channels.values - predicted(simulation, values)) / channels.noise_std
    return missed


def size(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


@pytest.mark.long
@pytest.mark.parametrize("name", EFFECTS)
def test_a_new_calibration_predicts_what_the_old_one_did_with_the_effect(folder: Path, name: str) -> None:
    known = read_files(folder).calibration
    made = applied(known, told(name), "extended.toml").calibration
    values = {f"{name}.{key}": value for key, value in EFFECTS[name].items()}
    with_effect, without = off(folder, known, values), off(folder, known, {})
    effect = size(with_effect - without)
    assert size(off(folder, made, {}) - with_effect) < 0.2 * effect


@pytest.mark.long
def test_the_gain_is_measured_on_the_next_recording_and_a_loss_is_refused(folder: Path, tmp_path: Path) -> None:
    true = read_files(folder).calibration
    file, extended = tmp_path / "unit.yaml", tmp_path / "extended.toml"
    wrong = applied(true, {"baseline_error": {"share": (-0.02, "1")}}, "x").calibration
    save_calibration(file, wrong)
    text = 'system = "wearable"\n[effects.baseline_error.share]\nvalue = {}\nunit = "1"\n'
    extended.write_text(text.format(-0.02), encoding="utf-8")
    with pytest.raises(UserError, match="gains nothing with"):
        app(["calibrate", "apply", str(file), str(extended), "--next", str(folder)], standalone_mode=False)
    assert load_calibration(file) == wrong
    extended.write_text(text.format(0.02), encoding="utf-8")
    app(["calibrate", "apply", str(file), str(tmp_path), "--next", str(folder)], standalone_mode=False)
    made = load_calibration(file)
    assert isinstance(made, Calibration)
    assert made.stereo.X_RL.p_m[0] == pytest.approx(true.stereo.X_RL.p_m[0], rel=1e-3)


def test_what_is_no_calibrations_is_named_and_left() -> None:
    known = draw_unit(3).exact_calibration()
    blur = {"motion_blur": {"exposure_s": (0.01, "s")}}
    made = applied(known, told("time_offset") | blur, "x")
    assert list(made.left) == ["motion_blur"]
    assert made.calibration.stereo.stamp_to_mid_exposure_s == known.stereo.stamp_to_mid_exposure_s - 0.004
    with pytest.raises(CalibrationError, match="x: effects motion_blur; allowed at least one of extrinsic_rotation"):
        applied(known, blur, "x")
