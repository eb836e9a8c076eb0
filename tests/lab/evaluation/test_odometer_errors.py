"""Errors of rendered walks on told ones: as they are or in a mirror, from the first step on, again where they end."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from lab.evaluation.odometer_errors import RenderedErrors
from lab.evaluation.told_steps import OdometerNoise, told_steps
from messages import UserError
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

CHANCE = np.random.default_rng(8)
ERRORS = RenderedErrors(CHANCE.normal(0.0, 1e-3, (5, 6)), np.array([np.eye(6) * (k + 1) for k in range(5)]))


def test_a_mirror_exchanges_left_and_right() -> None:
    signs = set()
    for seed in range(8):
        each = list(islice(ERRORS.each(np.random.default_rng(seed)), 12))
        ratio = each[0][0] / ERRORS.errors[0]
        np.testing.assert_allclose(each[7][0], ratio * ERRORS.errors[2])  # the third again
        np.testing.assert_allclose(each[7][1], ERRORS.covariances[2])
        signs.add(tuple(np.rint(ratio).astype(int).tolist()))
    assert signs == {(1, 1, 1, 1, 1, 1), (-1, 1, -1, 1, -1, 1)}


def test_told_steps_have_them() -> None:
    def told(errors: RenderedErrors | OdometerNoise) -> list[np.ndarray]:
        wearer = SimulatedWearer(3, scenario("turns"), 10_000_000_000, perfect_calibration=True)
        return [np.array((*each.step.turn_B, *each.step.travel_B)) for each in told_steps(wearer, 1.0, errors, 3)]

    off = np.array(told(ERRORS)) - np.array(told(OdometerNoise(0.0, 0.0)))
    np.testing.assert_allclose(np.abs(off[:5]), 0.05 * np.abs(ERRORS.errors), rtol=1e-6, atol=1e-12)


def test_a_file_brings_them_back(tmp_path: Path) -> None:
    ERRORS.write(tmp_path / "1.npz")
    found = RenderedErrors.read(tmp_path / "1.npz")
    np.testing.assert_array_equal(found.errors, ERRORS.errors)
    np.testing.assert_array_equal(found.covariances, ERRORS.covariances)
    (tmp_path / "2.npz").write_bytes(b"no")
    with pytest.raises(UserError, match=r"2\.npz: no errors of an odometer"):
        RenderedErrors.read(tmp_path / "2.npz")
