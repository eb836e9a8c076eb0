"""The attitude filter on real motion, beside VQF in the same run. One set of parameters; skipped without the data."""

import numpy as np
import pytest

from lab.evaluation.attitude import UNCALIBRATED, coverage, estimate, rms_deg, tilt_of_up_W, vqf_up_B
from lab.evaluation.measured.broad import HELD_OUT, TUNING, trials
from lab.evaluation.measured.euroc_flight import euroc_error_rad
from lab.evaluation.measured.foot_walk import foot_errors_rad
from tests.bench.data_folder import shared_data


@pytest.mark.long
def test_broad_inclination_beats_vqf_also_on_the_trials_nothing_was_tuned_on() -> None:
    data = trials(shared_data("broad"))
    assert [trial.name[:2] for trial in data] == sorted(TUNING + HELD_OUT)
    delay_s = float(np.mean([trial.imu_delay_s() for trial in data if trial.name[:2] in TUNING]))
    assert delay_s == pytest.approx(0.0043, abs=0.0003)
    ours, vqfs, held_out_coverage = {}, {}, []
    for trial in data:
        name = trial.name[:2]
        told = estimate(trial.t_ns, trial.sf_B, trial.w_B, UNCALIBRATED)
        ours[name] = rms_deg(trial.inclination_error_rad(told.up_B, -delay_s))
        peer = vqf_up_B(trial.sf_B, trial.w_B, trial.rate_hz)
        vqfs[name] = rms_deg(trial.inclination_error_rad(peer, 0.5 / trial.rate_hz - delay_s))
        if name in HELD_OUT:
            truth = trial.true_up_B(-delay_s)
            counted = trial.counted & ~np.isnan(truth[:, 0])
            held_out_coverage.append(coverage(tilt_of_up_W(told.R_WB[counted], truth[counted]), told.cov_W[counted]))
    assert np.mean(list(ours.values())) <= 0.45 < np.mean(list(vqfs.values()))
    assert np.mean([ours[name] for name in HELD_OUT]) <= 0.48 < np.mean([vqfs[name] for name in HELD_OUT])
    assert max(ours.values()) <= 0.65
    assert min(held_out_coverage) >= 0.9


def test_a_real_walking_foot_is_level_where_it_stands_flat() -> None:
    ours, vqfs = foot_errors_rad(shared_data("xio_foot_walk"))
    assert rms_deg(ours) <= 0.5 < rms_deg(vqfs)


def test_euroc_flight_starts_on_a_shaking_vehicle_and_stays_within_its_uncalibrated_bias() -> None:
    error = euroc_error_rad(shared_data("euroc_v1_01_easy"))
    assert len(error) > 1350  # of 1400: it started within the first seconds, motors running
    assert rms_deg(error) <= 1.0
