"""What is planted into a recording changes what it must, by laws of its own, and nothing else."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.hidden.imu.motion import Motion, hand_moved
from lab.hidden.imu.planted import EFFECTS, Recorded, drawn, leaning
from messages.arrays import FloatArray

RATE_HZ = 200.0


@pytest.fixture(scope="module")
def plain() -> Recorded:
    """Return ten seconds without noise, the reference at half the rate with a gap."""
    motion = Motion(hand_moved(np.random.default_rng(1), 12.0, 1.0), 9.80665, np.zeros(3))
    t_s, reference_t_s = np.arange(2000) / RATE_HZ, np.arange(1000) / 100.0
    q_WS = np.roll(motion.attitude(reference_t_s).as_quat(), 1, axis=1)
    q_WS[400:420] = np.nan
    p_W_m = motion.reference_position(reference_t_s)
    return Recorded(t_s, motion.turning(t_s), motion.specific_force(t_s), reference_t_s, q_WS, p_W_m)


def same(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.array_equal(a, b, equal_nan=True))


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_is_of_the_drawn_size_and_follows_from_the_seed_alone(effect: str, plain: Recorded) -> None:
    first, again = (drawn(effect, np.random.default_rng(7), plain) for _ in range(2))
    assert first.cause == again.cause
    assert first.cause.name == effect
    a, b = (each.planted(plain) for each in (first, again))
    changed = [name for name in vars(plain) if not same(getattr(plain, name), getattr(a, name))]
    assert changed
    assert all(same(getattr(a, name), getattr(b, name)) for name in vars(plain))
    assert all(np.isnan(getattr(a, name)).sum() <= np.isnan(plain.q_WS).sum() for name in vars(plain))


def test_axes_of_a_triad_lean_by_their_shares_and_keep_their_length() -> None:
    shares = np.array(((0.0, 0.02, 0.0), (0.0, 0.0, -0.03), (0.0, 0.0, 0.0)))
    triad = leaning(shares)
    assert np.allclose(np.linalg.norm(triad, axis=1), 1.0)
    assert triad[0, 1] == pytest.approx(0.02)
    assert triad[1, 2] == pytest.approx(-0.03)
    assert np.allclose(triad[2], (0.0, 0.0, 1.0))


def of(effect: str, plain: Recorded, wanted: Callable[[dict[str, float]], bool]) -> tuple[dict[str, float], Recorded]:
    """Return an effect whose drawn parameters are as wanted, and the recording with it."""
    for seed in range(100):
        planting = drawn(effect, np.random.default_rng(seed), plain)
        if wanted(planting.cause.parameters):
            return planting.cause.parameters, planting.planted(plain)
    raise AssertionError(effect)


def test_a_low_pass_weakens_a_tone_at_its_cut_off_by_the_root_of_two(plain: Recorded) -> None:
    parameters, _ = of("low_pass", plain, lambda told: set(told) == {"gyro_hz"})
    f_hz = parameters["gyro_hz"]
    tone = np.sin(2.0 * np.pi * f_hz * plain.t_s)[:, None] * np.ones(3)
    _, told = of(
        "low_pass", Recorded(plain.t_s, tone, tone, *list(vars(plain).values())[3:]), lambda p: p == parameters
    )
    settled = slice(1000, None)
    assert told.w_radps[settled].std() / tone[settled].std() == pytest.approx(np.sqrt(0.5), rel=0.02)
    assert same(told.sf_mps2, tone)


def test_a_mount_amplifies_near_its_resonance_and_leaves_gravity(plain: Recorded) -> None:
    parameters, told = of("vibration", plain, lambda p: len(p) == 1)
    axis = "xyz".index(next(iter(parameters))[0])
    assert told.sf_mps2[:, axis].mean() == pytest.approx(plain.sf_mps2[:, axis].mean(), abs=0.02)
    others = [k for k in range(3) if k != axis]
    assert same(told.sf_mps2[:, others], plain.sf_mps2[:, others])


def test_a_lever_arm_and_a_turned_frame_are_those_of_the_reference(plain: Recorded) -> None:
    parameters, told = of("lever_arm", plain, lambda p: set(p) == {"x_m"})
    seen = np.isfinite(plain.q_WS).all(axis=1)
    attitude = Rotation.from_quat(np.roll(plain.q_WS[seen], -1, axis=1))
    back = attitude.apply(plain.p_W_m[seen] - told.p_W_m[seen], inverse=True)
    assert np.allclose(back, (parameters["x_m"], 0.0, 0.0))
    parameters, told = of("frame_rotation", plain, lambda p: set(p) == {"z_rad"})
    turned = Rotation.from_quat(np.roll(told.q_WS[seen], -1, axis=1))
    assert np.allclose((attitude.inv() * turned).as_rotvec(), (0.0, 0.0, parameters["z_rad"]))
