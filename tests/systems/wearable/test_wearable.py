"""The wearable's plug-in: its geometry against exact projection, its neutral values, its files."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter1d
from scipy.spatial.transform import Rotation

from discrepancy.values import predicted
from lab.hidden.case import Case, Kind
from lab.hidden.wearable import EFFECTS, LOOK_ALIKES, OUTSIDE, PAIRS, SIZES
from lab.hidden.wearable.physics import hidden
from lab.hidden.wearable.recording import write_recording
from lab.hidden.wearable.walk import draw_nuisance, faultless_scene, faultless_unit
from messages import ImuSample
from messages.arrays import FloatArray
from messages.errors import UserError
from systems.wearable import load, view
from systems.wearable.blur import Steepness
from systems.wearable.effects import library
from systems.wearable.simulation import WearableSimulation
from systems.wearable.tilt import Sensed

SEED = 41
FRAMES = 32
LIBRARY = (
    "imu_bias",
    "acceleration_disturbance",
    "extrinsic_rotation",
    "time_offset",
    "baseline_error",
    "focal_error",
    "toe_in",
    "distortion_residual",
    "motion_blur",
    "rolling_shutter",
    "pixel_locking",
    "exposure_change",
    "texture_bias",
    "ground_not_flat",
    "soft_mount",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    walk = draw_nuisance(Case("wearable", SEED, Kind.CLEAN, ()), "fit", 1.0)
    folder = tmp_path_factory.mktemp("wearable") / "clean"
    write_recording(replace(faultless_scene(faultless_unit(SEED), walk), frames=FRAMES), folder)
    return folder


@pytest.fixture(scope="module")
def simulation(folder: Path) -> WearableSimulation:
    return load(folder)


def test_library_holds_exactly_the_stated_effects() -> None:
    assert {effect.name for effect in library(with_reference=True)} == set(LIBRARY)
    assert set(EFFECTS) == set(LIBRARY)
    assert len(OUTSIDE) >= 6
    assert not set(OUTSIDE) & set(LIBRARY)
    assert {name for names in (*PAIRS, *LOOK_ALIKES) for name in names} <= set(LIBRARY)


def test_every_hidden_effect_tells_parameters_of_the_library() -> None:
    known = {effect.name: {p.name: p for p in effect.parameters} for effect in library(with_reference=True)}
    for seed in range(1, 7):
        for name in EFFECTS:
            case = Case("wearable", seed, Kind.SINGLE, (name,))
            size = SIZES[name].drawn(case.stream("size"))
            for parameter, value in hidden(name, size, case.stream("cause")).parameters.items():
                expected = known[name][parameter]
                assert expected.low <= value <= expected.high
                assert abs(value - expected.neutral) > 2.0 * expected.scale


def test_neutral_values_are_the_base_model_and_prediction_is_pure(simulation: WearableSimulation) -> None:
    neutral = {
        effect.qualified(parameter.name): parameter.neutral
        for effect in simulation.effects
        for parameter in effect.parameters
    }
    assert predicted(simulation, neutral).tobytes() == predicted(simulation, {}).tobytes()
    bent = {"toe_in.y_rad": 1e-3, "time_offset.value_s": 2e-3}
    assert predicted(simulation, bent).tobytes() == predicted(simulation, bent).tobytes()


def test_sound_recording_leaves_hardly_a_residual(simulation: WearableSimulation) -> None:
    channels = simulation.channels
    assert len(channels.t_s) == FRAMES
    assert channels.rate_hz == pytest.approx(20.0, rel=1e-6)
    residual = channels.values - predicted(simulation, {})
    rms = dict(zip(channels.names, np.sqrt(np.nanmean(residual**2, axis=0)), strict=True))
    assert all(value < 0.03 for name, value in rms.items() if name.startswith("disparity"))
    assert rms["disparity_xx_px"] < 0.01
    assert all(value < 0.006 for name, value in rms.items() if name.endswith("_rad"))


def test_every_effect_changes_the_prediction_and_stays_finite(simulation: WearableSimulation) -> None:
    base = predicted(simulation, {})
    for effect in simulation.effects:
        start = effect.starts[0] if effect.starts else {}
        values = {p.name: start.get(p.name, p.neutral) for p in effect.parameters}
        values |= {p.name: p.neutral + 10.0 * p.scale for p in effect.parameters if p.name not in start}
        there = predicted(simulation, {effect.qualified(name): value for name, value in values.items()})
        assert np.isfinite(there[np.isfinite(base)]).all(), effect.name
        assert np.nanmax(np.abs(there - base)) > 1e-4, effect.name


def test_turned_ground_is_that_of_a_turned_camera() -> None:
    theta, turn_C = np.array([1.5, 40.0, 33.0]), np.array([0.02, -0.01, 0.03])
    exact = Rotation.from_rotvec(turn_C).as_matrix().T @ theta
    assert view.turned(theta, turn_C) == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize(("share", "column"), [(0.01, 0), (-0.02, 3), (0.03, 5)])
def test_baseline_error_stretches_every_disparity(simulation: WearableSimulation, share: float, column: int) -> None:
    change = predicted(simulation, {"baseline_error.share": share}) - predicted(simulation, {})
    ground = simulation._operator[FRAMES // 2] @ simulation._scene.disparity_px[FRAMES // 2]
    assert change[FRAMES // 2, column] == pytest.approx(share * ground[column], rel=1e-6)


def test_soft_mount_lags_the_body_like_its_transfer_function(simulation: WearableSimulation) -> None:
    hz, zeta, shaken_hz = 6.0, 0.2, 3.0
    t_s = simulation._path.grid_s
    kept = simulation._gyro_C
    try:
        simulation._gyro_C = np.outer(np.cos(2 * np.pi * shaken_hz * t_s), np.ones(3))
        swing = simulation._swing_C(hz, zeta)[len(t_s) // 2 :, 0]
    finally:
        simulation._gyro_C = kept
    s, omega = 2j * math.pi * shaken_hz, 2 * math.pi * hz
    assert np.abs(swing).max() == pytest.approx(abs(-s / (s * s + 2 * zeta * omega * s + omega**2)), rel=0.05)


def test_a_smear_flattens_the_slope_along_it_as_the_picture_itself_tells() -> None:
    random = np.random.default_rng(SEED)
    picture = gaussian_filter(random.standard_normal((500, 500)), 1.5, mode="wrap")

    def slopes(field: FloatArray) -> float:
        return float(np.log2(np.std(np.diff(field, axis=0)) / np.std(np.diff(field, axis=1))))

    lags = (1, 2, 3, 4, 6, 8, 12)
    difference = np.array([[np.mean((picture[:, lag:] - picture[:, :-lag]) ** 2) for lag in lags]])
    told = Steepness(lags, difference)
    for smear_px in (5, 9):
        smeared = uniform_filter1d(picture, smear_px, axis=0, mode="wrap")
        expected = slopes(smeared) - slopes(picture)
        assert told.loss(np.array([[float(smear_px)]]))[0, 0] == pytest.approx(expected, rel=0.3)
    assert told.loss(np.array([[0.0]]))[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_samples_are_dated_by_the_line_that_the_driver_laid_last() -> None:
    true_ns = 20_000_000_000 + 10_000_000 * np.arange(400)
    early = np.where(np.arange(400) < 360, 2_000_000 - 4_000 * np.arange(400), 0)
    missing = np.arange(400) != 123
    dated = Sensed.of(
        [_sample(t_ns) for t_ns in (true_ns + early)[missing]], faultless_unit(SEED).exact_calibration()
    ).t_s
    assert dated == pytest.approx(true_ns[missing] * 1e-9, abs=1e-8)


def _sample(t_ns: np.int64) -> ImuSample:
    return ImuSample(
        seq=0,
        t_sample_ns=int(t_ns),
        t_arrival_ns=int(t_ns),
        sf_B_mps2=(0.0, 0.0, 9.81),
        w_WB_B_radps=(0.0, 0.0, 0.0),
        temperature_degC=25.0,
    )


def test_without_reference_only_the_disparities_are_judged(folder: Path, tmp_path: Path) -> None:
    for name in ("walk.mcap", "ground.csv"):
        shutil.copy(folder / name, tmp_path / name)
    simulation = load(tmp_path)
    assert "gyro_roll_rad" not in simulation.channels.names
    assert "imu_bias" not in {effect.name for effect in simulation.effects}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("t_s,nx,ny,nz\n1,0,0,1\n", "column height_m is missing"),
        ("t_s,nx,ny,nz,height_m\n1,0,0,1,0.9\n2,0,0,2,0.9\n", "row 3, column nx, ny, nz"),
        ("t_s,nx,ny,nz,height_m\n1,0,0,1,0.9\n1,0,0,1,0.9\n", "row 3, column t_s does not rise"),
        ("t_s,nx,ny,nz,height_m\n1,0,0,1,0.9\n2,0,0,1,metre\n", "row 3, column height_m is 'metre'"),
        ("t_s,nx,ny,nz,height_m\n1,0,0,1,0.9\n2,0,0,1,9.9\n", "row 3, column height_m is outside"),
    ],
)
def test_a_wrong_ground_is_one_line(folder: Path, tmp_path: Path, table: str, message: str) -> None:
    shutil.copy(folder / "walk.mcap", tmp_path / "walk.mcap")
    (tmp_path / "ground.csv").write_text(table)
    with pytest.raises(UserError) as raised:
        load(tmp_path)
    assert str(raised.value).startswith(f"{tmp_path / 'ground.csv'}: {message}")
    assert "\n" not in str(raised.value)


def test_a_folder_without_recording_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds 0 MCAP files; expected one"):
        load(tmp_path)
