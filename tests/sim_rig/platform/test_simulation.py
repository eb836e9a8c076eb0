"""The simulated platform: its recordings obey the equations, and its instruments do what they should."""

from pathlib import Path

import numpy as np
import pytest
from scipy import fft

from messages.arrays import FloatArray

pytest.importorskip("mujoco")

from impedance.body.geometry import rotation_IP
from impedance.body.kinematics import Kinematics
from impedance.recording.recording import PlatformRecording, read_truth
from sim_rig.platform.excitation import sampled
from sim_rig.platform.rig import FOOT, MOTION_HZ, THESIS_NOISE, Noise, Rig
from sim_rig.platform.run import RunSettings, SimulatedRun, bare_plate_tare, measured, simulate

BAND_HZ = 60.0
EDGE = 350
SHORT_S = 8.0


@pytest.fixture(scope="module", params=["plate", "plate and foot"])
def run(request: pytest.FixtureRequest) -> SimulatedRun:
    return simulate(RunSettings(rig=Rig(foot=FOOT if "foot" in request.param else None), duration_s=SHORT_S), seed=5)


def differentiated(values: FloatArray, order: int) -> FloatArray:
    """Return the derivative of samples (n, c), a tapered Fourier transform's, right between the edges."""
    n = len(values)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(np.arange(n), n - 1 - np.arange(n)) / (0.8 * EDGE), 0.0, 1.0))
    jw = 2j * np.pi * np.fft.rfftfreq(n, 1.0 / MOTION_HZ)[:, None]
    mean = values.mean(axis=0)
    return np.asarray(fft.irfft(jw**order * fft.rfft((values - mean) * ramp[:, None], axis=0), n, axis=0))


def in_band(values: FloatArray) -> FloatArray:
    """Return the part below BAND_HZ of samples (n, c), between the edges, under a window of mean square 1."""
    inner = values[EDGE:-EDGE]
    window = np.hanning(len(inner))[:, None] * np.sqrt(8.0 / 3.0)
    spectrum = np.fft.rfft(inner * window, axis=0)
    spectrum[np.fft.rfftfreq(len(inner), 1.0 / MOTION_HZ) > BAND_HZ] = 0.0
    return np.fft.irfft(spectrum, len(inner), axis=0)


def misfit(run: SimulatedRun) -> tuple[FloatArray, FloatArray]:
    """Return the in-band rms (6,) of simulated minus analytic wrench, out of the poses alone, and of the wrench."""
    recording = measured(run, noise=None)
    p_m, euler = recording.plate.p_m, recording.plate.euler_rad
    motion = Kinematics.of_pose(euler, differentiated(euler, 1), differentiated(euler, 2), differentiated(p_m, 2))
    wrench = recording.wrench + bare_plate_tare(run.settings.rig)
    left = in_band(motion.regressor @ run.settings.rig.above_sensor.vector - wrench)
    return np.sqrt((left**2).mean(axis=0)), np.sqrt((in_band(wrench) ** 2).mean(axis=0))


def test_gate_simulated_minus_analytic_wrench_is_a_tenth_of_the_noise(run: SimulatedRun) -> None:
    noise = np.repeat((THESIS_NOISE.force_n, THESIS_NOISE.torque_nm), 3) * np.sqrt(2.0 * BAND_HZ / MOTION_HZ)
    assert (misfit(run)[0] <= 0.1 * noise).all()


def test_raw_steps_alias_and_leave_percents_of_the_wrench_unexplained() -> None:
    left, whole = misfit(simulate(RunSettings(duration_s=SHORT_S, raw=True), seed=5))
    power = (left[[0, 2, 3, 5]] / whole[[0, 2, 3, 5]]) ** 2
    assert (power > 0.005).all()
    assert (power < 0.2).all()


def test_a_run_is_repeatable_and_swings_as_said(run: SimulatedRun) -> None:
    again = simulate(run.settings, seed=5)
    np.testing.assert_array_equal(again.wrench, run.wrench)
    assert np.abs(again.angles_rad - simulate(run.settings, seed=6).angles_rad).max() > 1e-3
    swing = np.rad2deg(run.angles_rad.std(axis=0))
    assert (swing > 0.3).all()
    assert (swing < 1.0).all()
    assert np.rad2deg(np.abs(run.angles_rad).max()) < 3.0


def test_exact_motion_matches_the_poses(run: SimulatedRun) -> None:
    motion, a_I = run.kinematics, differentiated(run.plate.p_m, 2)
    a_P = (a_I[:, None, :] @ rotation_IP(*run.plate.euler_rad.T))[:, 0]
    scale = motion.a_O_P.std()
    np.testing.assert_allclose(in_band(a_P), in_band(motion.a_O_P), atol=2e-3 * scale)


def test_tare_and_resting_foot_read_as_the_thesis_says() -> None:
    still = sampled(np.array([0.0, 10.0]), np.zeros((2, 2)))
    plate, both = (
        measured(simulate(RunSettings(rig=Rig(foot=foot), duration_s=4.0, excitation=still), seed=0), noise=None)
        for foot in (None, FOOT)
    )
    assert both.wrench[-1, 1] == pytest.approx(22.68 * 9.81, abs=0.1)
    assert np.abs(plate.wrench[-1]).max() < 0.05  # gravity tilts the plate by a hair until the springs hold it


def test_noise_is_drawn_anew_with_the_declared_deviations(run: SimulatedRun) -> None:
    clean, first, second = (
        measured(run, noise, seed) for noise, seed in ((None, 0), (THESIS_NOISE, 1), (THESIS_NOISE, 2))
    )
    for found, expected in (
        (first.plate.p_m - clean.plate.p_m, THESIS_NOISE.position_m),
        (first.plate.euler_rad - clean.plate.euler_rad, THESIS_NOISE.angle_rad),
        (first.wrench[:, :3] - clean.wrench[:, :3], THESIS_NOISE.force_n),
        (first.wrench[:, 3:] - clean.wrench[:, 3:], THESIS_NOISE.torque_nm),
    ):
        assert found.std() == pytest.approx(expected, rel=0.05)
        assert abs(found.mean()) < 0.1 * expected
    assert np.abs(first.wrench - second.wrench).max() > 0.1
    np.testing.assert_array_equal(measured(run, THESIS_NOISE, 1).wrench, first.wrench)


def test_a_written_recording_reads_back_and_keeps_the_truth_apart(run: SimulatedRun, tmp_path: Path) -> None:
    recording = measured(run, Noise(1e-4, 1e-5, 0.1, 0.05), seed=3, plate=run.settings.rig.plate)
    recording.save(tmp_path, run.truth)
    loaded = PlatformRecording.load(tmp_path)
    assert loaded.settings == recording.settings
    assert loaded.notes == ()
    np.testing.assert_allclose(loaded.plate.columns, recording.plate.columns, atol=1e-10)
    np.testing.assert_allclose(loaded.wrench, recording.wrench, atol=1e-8)
    np.testing.assert_allclose(loaded.t_s, recording.t_s, atol=1e-9)
    truth = read_truth(tmp_path)
    np.testing.assert_allclose(truth.plate.vector, run.settings.rig.plate.vector, atol=1e-15)
    assert (truth.foot is None) == (run.settings.rig.foot is None)
    assert not hasattr(loaded, "truth")
