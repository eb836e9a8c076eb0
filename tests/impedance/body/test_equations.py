"""The corrected equations of motion against a multibody engine's sensors, and the forms of them against each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance.body import geometry
from impedance.body.equations import (
    body_wrench,
    foot_residual,
    plate_and_foot_wrench,
    plate_residual,
    plate_wrench,
    tare,
)
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia
from messages.arrays import FloatArray
from sim_rig.platform.rig import PLATE, UPPER_FRAME, Rig

RELATIVE = 1e-9
seeds = st.integers(0, 2**32 - 1)


def random_body(rng: np.random.Generator) -> Inertia:
    """Return a body made of eight point masses and a little ball: any rigid body is."""
    masses, places = rng.uniform(0.1, 3.0, 8), rng.uniform(-0.2, 0.2, (8, 3))
    cog_m = masses @ places / masses.sum()
    away = places - cog_m
    tensor = (masses * (away**2).sum(axis=1)).sum() * np.eye(3) - (away.T * masses) @ away + 1e-4 * np.eye(3)
    return Inertia(float(masses.sum()), cog_m, tensor)


def sensed(rig: Rig, state: FloatArray, torque_nm: FloatArray) -> dict[str, FloatArray]:
    """Return what the engine's sensors read in one state (θ, φ, θ̇, φ̇) under torques about Z and X."""
    mujoco = pytest.importorskip("mujoco")
    from sim_rig.platform.model import SENSORS, model_of

    model = model_of(rig, 1e-3, direct=True)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = state[:2], state[2:], torque_nm
    mujoco.mj_forward(model, data)
    found = {name: np.array(data.sensordata[where])[None] for name, where in SENSORS.items()}
    found["second"] = np.array(data.qacc)[None]
    return found


def motion_of(rig: Rig, sensors: dict[str, FloatArray]) -> Kinematics:
    return Kinematics.on_joint(sensors["angles"], sensors["rates"], sensors["second"], rig.lever_m)


def assert_relative(found: FloatArray, expected: FloatArray) -> None:
    """Compare forces by the largest force, moments by the largest moment."""
    for part in (slice(0, 3), slice(3, 6)):
        error = np.abs(found[..., part] - expected[..., part]).max()
        assert error <= RELATIVE * np.abs(expected[..., part]).max()


@settings(max_examples=60, deadline=None)
@given(seed=seeds, with_foot=st.booleans())
def test_analytic_wrench_meets_the_engines_sensors(seed: int, with_foot: bool) -> None:
    rng = np.random.default_rng(seed)
    rig = Rig(
        plate=random_body(rng),
        foot=random_body(rng) if with_foot else None,
        upper_frame=random_body(rng),
        foot_origin_m=tuple(rng.uniform(-0.2, 0.2, 3).tolist()),
        joint_to_surface_m=float(rng.uniform(0.05, 0.3)),
    )
    state = rng.uniform([-0.5, -0.5, -10, -10], [0.5, 0.5, 10, 10])
    sensors = sensed(rig, state, rng.uniform(-500.0, 500.0, 2))
    motion = motion_of(rig, sensors)
    if rig.foot is None:
        analytic = plate_wrench(rig.plate, motion)
    else:
        analytic = plate_and_foot_wrench(rig.plate, rig.foot, motion, np.eye(3), np.array(rig.foot_origin_m))
    assert_relative(analytic + tare(rig.plate), sensors["wrench"])


@settings(max_examples=30, deadline=None)
@given(seed=seeds)
def test_kinematics_meet_the_engines_accelerometer_and_gyroscope(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = Rig()
    sensors = sensed(rig, rng.uniform([-0.5, -0.5, -10, -10], [0.5, 0.5, 10, 10]), rng.uniform(-500.0, 500.0, 2))
    motion = motion_of(rig, sensors)
    _, euler = geometry.joint_pose(sensors["angles"][:, 0], sensors["angles"][:, 1], rig.joint_to_surface_m)
    alpha_I = geometry.rotation_IP(*euler.T)[0] @ motion.alpha[0]
    np.testing.assert_allclose(motion.w, sensors["w"], rtol=RELATIVE, atol=RELATIVE)
    np.testing.assert_allclose(alpha_I, sensors["alpha_I"][0], rtol=RELATIVE, atol=1e-7)
    np.testing.assert_allclose(motion.a_O_P - motion.g_P, sensors["specific_force"], rtol=RELATIVE, atol=1e-7)


def test_springs_damping_and_hidden_frame_change_the_motion_not_its_relation_to_the_wrench() -> None:
    state, torque_nm = np.array([0.02, -0.01, 1.0, 0.5]), np.array([100.0, -50.0])
    soft = Rig(stiffness_nmprad=(1.0, 1.0), damping_nmsprad=(0.0, 0.0), upper_frame=PLATE)
    stiff, loose = ((rig, sensed(rig, state, torque_nm)) for rig in (Rig(), soft))
    assert np.abs(stiff[1]["second"] - loose[1]["second"]).min() > 1.0
    for rig, found in (stiff, loose):
        assert_relative(body_wrench(rig.plate, motion_of(rig, found)), found["wrench"])


@settings(max_examples=100, deadline=None)
@given(seed=seeds)
def test_the_regressor_says_the_same_linearly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body = random_body(rng)
    motion = Kinematics(*(rng.normal(size=(4, 3)) for _ in range(4)))
    np.testing.assert_allclose(motion.regressor @ body.vector, body_wrench(body, motion), rtol=1e-9, atol=1e-9)
    again = Inertia.from_vector(body.vector)
    np.testing.assert_allclose(again.inertia_kgm2, body.inertia_kgm2, atol=1e-12)
    assert body.is_consistent
    assert body.checked() is body


@settings(max_examples=50, deadline=None)
@given(seed=seeds)
def test_a_mounted_foot_is_one_more_body_of_the_plate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plate, foot, p_PF_m = random_body(rng), random_body(rng), rng.uniform(-0.2, 0.2, 3)
    R_PF = geometry.rotation_IP(*rng.uniform(-1.0, 1.0, (3, 1)))[0]
    motion = Kinematics(*(rng.normal(size=(4, 3)) for _ in range(4)))
    both = plate.joined(foot.seen_from(R_PF, p_PF_m))
    expected = body_wrench(both, motion) - tare(plate)
    found = plate_and_foot_wrench(plate, foot, motion, R_PF, p_PF_m)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(plate_residual(both, motion, plate_wrench(both, motion)), 0.0, atol=1e-12)
    np.testing.assert_allclose(foot_residual(foot, plate, motion, R_PF, p_PF_m, found), 0.0, atol=1e-12)


@settings(deadline=None)
@given(
    euler=st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3),
    rate=st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3),
    second=st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3),
)
def test_angular_velocity_and_acceleration_are_those_of_the_turning_matrix(
    euler: list[float], rate: list[float], second: list[float]
) -> None:
    h = 1e-3
    t = h * np.arange(-2, 3)[:, None]
    angles = np.array(euler) + t * np.array(rate) + 0.5 * t**2 * np.array(second)
    rates = np.array(rate) + t * np.array(second)
    R = geometry.rotation_IP(*angles.T)
    weights = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * h)
    turning = R[2].T @ np.einsum("k,kij->ij", weights, R)
    w = geometry.angular_velocity(angles, rates)
    np.testing.assert_allclose([turning[2, 1], turning[0, 2], turning[1, 0]], w[2], atol=2e-7)
    alpha = geometry.angular_acceleration(angles[2:3], rates[2:3], np.array([second]))[0]
    np.testing.assert_allclose(weights @ w, alpha, atol=2e-4)
    np.testing.assert_allclose(geometry.euler_of(R), angles, atol=1e-9)


def test_the_thesiss_bodies_can_exist_but_for_what_it_misprints() -> None:
    assert PLATE.is_consistent
    assert UPPER_FRAME.is_consistent
    as_printed = Inertia.about(9.0, UPPER_FRAME.cog_m, np.array([0.9, 0.9, 0.3, 0.2, 0.1, 0.1]))
    foot = Inertia.about(22.68, np.zeros(3), 1e-3 * np.array([81.1, 127.0, 137.2, 81.1, 127.0, 137.2]))
    for body in (as_printed, foot):
        assert not body.is_consistent
        with pytest.raises(ValueError, match="no rigid body"):
            body.checked()
