"""Real inertias: bicycles by pendulum beside the published values, a robot arm's held-out torque. Skipped without
data."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from impedance.body.pendulum import centre_of_pairs
from impedance.body.physical import is_consistent
from lab.evaluation.measured.bicycle import BICYCLES, compared, raw_period
from lab.evaluation.measured.kuka import (
    JOINTS,
    Joint,
    Run,
    columns,
    identified,
    judged,
    read_arm,
    read_run,
    splits,
    told,
)
from messages.arrays import FloatArray
from tests.bench.data_folder import shared_data


@pytest.mark.parametrize("name", BICYCLES)
def test_published_bicycle_inertias_come_out_within_a_tenth_of_their_deviation(name: str) -> None:
    rows = compared(shared_data("bicycle_pendulum_inertia"), name, centre_of_pairs)
    assert len(rows) >= 16
    for row in rows:
        assert abs(row.off) <= 0.1, row
        assert 0.5 <= row.our_deviation / row.published_deviation <= 1.5, row


def test_least_squares_of_the_hanging_lines_agrees_within_two_published_deviations() -> None:
    off = [
        abs(row.off)
        for name in ("Browser", "Browserins", "Rigid")
        for row in compared(shared_data("bicycle_pendulum_inertia"), name)
    ]
    assert max(off) <= 2.0


def test_the_raw_gyro_swings_with_the_stated_period() -> None:
    period_s, deviation_s = raw_period(shared_data("bicycle_pendulum_inertia"))
    assert round(period_s, 2) == 1.59
    assert deviation_s < 1e-4


def test_the_arm_identified_on_one_half_predicts_the_other() -> None:
    folder = shared_data("kuka_lwr4_excitation")
    joints, run = read_arm(folder / "kuka_lwr4.urdf"), read_run(folder / "measurements_1.npz")
    run = Run(run.q[::4], run.rate[::4], run.acceleration[::4], run.torque[::4])
    Y, prior = columns(joints, run), told(joints)
    a_priori = judged(Y, run.torque, prior).relative
    assert a_priori == pytest.approx(0.0924, abs=0.003)
    chosen = splits(len(run.q))["first half"]
    vector = identified(Y[chosen], run.torque[chosen], prior)
    assert is_consistent(vector[: 10 * JOINTS].reshape(JOINTS, 10))
    assert judged(Y[chosen], run.torque[chosen], vector).relative < 0.025
    assert judged(Y[~chosen], run.torque[~chosen], vector).relative < 0.03


def test_the_arms_columns_are_its_energy_balance() -> None:
    folder = shared_data("kuka_lwr4_excitation")
    joints, run = read_arm(folder / "kuka_lwr4.urdf"), read_run(folder / "measurements_1.npz")
    prior = told(joints)
    prior[10 * JOINTS :] = 0.0
    still = Run(run.q[::200], 0.0 * run.q[::200], 0.0 * run.q[::200], run.torque[::200])
    gravity = columns(joints, still) @ prior
    step = 1e-5
    for joint in range(JOINTS):
        moved = run.q[::200].copy()
        moved[:, joint] += step
        ahead = _potential(joints, moved)
        moved[:, joint] -= 2 * step
        slope = (ahead - _potential(joints, moved)) / (2 * step)
        np.testing.assert_allclose(gravity[:, joint], slope, atol=1e-6)


def _potential(joints: list[Joint], q: FloatArray) -> FloatArray:
    energy = np.zeros(len(q))
    for row, angles in enumerate(q):
        R, p = np.eye(3), np.zeros(3)
        for joint, angle in zip(joints, angles, strict=True):
            p = p + R @ joint.p_m
            R = R @ joint.R @ Rotation.from_rotvec(angle * joint.axis).as_matrix()
            energy[row] += 9.81 * joint.link.mass_kg * (p + R @ joint.link.cog_m)[2]
    return energy
