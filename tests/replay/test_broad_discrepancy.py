"""Real trials as recordings of an IMU: an effect planted into one changes that parameter by the planted size."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discrepancy import explain
from lab.evaluation.measured.broad_recordings import simulation_of, stretch, trial
from systems.imu.broad import import_trial
from systems.imu.recording import ImuRecording
from tests.bench.data_folder import shared_data

ONLY = ("time_offset", "gyro_bias", "acc_scale", "lever_arm")
SECONDS = 30.0


def fitted(recording: ImuRecording) -> dict[str, float]:
    simulation = simulation_of(recording)
    return dict(explain(simulation, simulation, seed=1, only=ONLY).values_after)


def planted(real: ImuRecording, sign: float) -> ImuRecording:
    return replace(
        real,
        t_s=real.t_s + 0.006 * sign,
        w_radps=real.w_radps + np.array((0.0, 0.02, 0.0)) * sign,
        sf_mps2=real.sf_mps2 * (1.0 + np.array((0.0, 0.0, 0.02)) * sign),
    )


@pytest.mark.long
def test_an_effect_planted_into_a_real_trial_changes_its_parameter_by_its_size() -> None:
    real = stretch(trial(shared_data("broad"), "01"), 40.0, SECONDS)
    more, less = (fitted(planted(real, sign)) for sign in (1.0, -1.0))
    for key, size, tolerance in (
        ("time_offset.value_s", 0.006, 3e-4),
        ("gyro_bias.y_radps", 0.02, 4e-4),
        ("acc_scale.z", 0.02, 1e-3),
    ):
        assert abs(0.5 * (more[key] - less[key]) - size) < tolerance, (key, more[key], less[key])
    natural_s = 0.5 * (more["time_offset.value_s"] + less["time_offset.value_s"])
    assert 0.002 < natural_s < 0.006  # known from the turning rates alone: 4.3 ms


def test_a_trial_becomes_plain_files(tmp_path: Path) -> None:
    folder = shared_data("broad")
    path = next(iter(sorted(folder.glob("01_*.npz"))))
    import_trial(path, tmp_path)
    again, first = ImuRecording.load(tmp_path), trial(folder, "01")
    assert np.allclose(again.w_radps, first.w_radps, rtol=1e-9)
    assert np.array_equal(np.isnan(again.p_W_m), np.isnan(first.p_W_m))
