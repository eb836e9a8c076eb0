"""The noise model of a resting force plate, judged on real plates' held-out halves."""

import numpy as np
import pytest

from impedance.recording.force_noise import fit_force_noise
from lab.evaluation.measured.force_plate import PLATES, WRENCH, innovation_ratio, resting_plates
from tests.bench.data_folder import shared_data


def test_real_plates_are_predicted_by_their_first_half() -> None:
    t_s, plates = resting_plates(shared_data("force_plate_at_rest"))
    half = len(t_s) // 2
    for plate in PLATES:
        first = fit_force_noise(t_s[:half], plates[plate][:half], WRENCH)
        for channel, y in zip(first.channels, plates[plate][half:].T, strict=True):
            assert innovation_ratio(channel, y) == pytest.approx(1.0, abs=0.2)
        drawn = first.generate(half, np.random.default_rng(2))
        np.testing.assert_allclose(drawn.std(axis=0), plates[plate][half:].std(axis=0), rtol=0.25)
        correlation, expected = np.corrcoef(drawn.T), np.corrcoef(plates[plate][half:].T)
        assert np.abs(correlation - expected).max() < 0.35
