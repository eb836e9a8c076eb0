"""The IMU's turn beside the camera's: a contradiction within a step or two, no false one, ended in half a second."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.motion.turn_balance import Turn, TurnBalance, TurnBalanceSettings

STEP_S = 0.05
NOISE_RADPS = 0.02


def walking(k: int, phase: float = 0.0) -> np.ndarray:
    """Return a walker's rate in step `k`: half a radian a second at 1.8 Hz."""
    return 0.5 * np.sin(2.0 * math.pi * 1.8 * STEP_S * k + phase + np.array([0.0, 1.0, 2.0]))


def turn(felt_radps: np.ndarray, seen_radps: np.ndarray) -> Turn:
    return Turn(STEP_S, STEP_S * felt_radps, STEP_S * seen_radps)


def walked(balance: TurnBalance, steps: range, seed: int, wrong: np.ndarray, bias: np.ndarray) -> list[bool]:
    """Let the IMU measure steps `wrong` times as they are plus `bias`; return after which they contradicted."""
    chance, said = np.random.default_rng([seed, steps.start]), []
    for k in steps:
        told = turn(wrong * walking(k, seed) + bias, walking(k, seed) + chance.normal(0.0, NOISE_RADPS, 3))
        balance.add_provisional(told)
        balance.add(told)
        said.append(balance.contradicted)
    return said


RIGHT, NONE = np.ones(3), np.zeros(3)


@given(seed=st.integers(0, 1000), bias=st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3))
def test_a_walk_with_a_steady_bias_contradicts_nothing(seed: int, bias: list[float]) -> None:
    assert not any(walked(TurnBalance(), range(400), seed, RIGHT, np.array(bias)))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("seed", range(4))
def test_a_changed_sign_contradicts_before_it_has_spoilt_three_degrees(axis: int, seed: int) -> None:
    balance, wrong = TurnBalance(), np.where(np.arange(3) == axis, -1.0, 1.0)
    walked(balance, range(100), seed, RIGHT, NONE)
    said = walked(balance, range(100, 140), seed, wrong, NONE)
    first = said.index(True)
    spoilt = sum(2.0 * STEP_S * walking(k, seed)[axis] for k in range(100, 100 + first))
    assert first < 6
    assert abs(spoilt) < math.radians(3.0)


def test_a_bias_that_jumps_contradicts_as_long_as_it_lasts_and_is_forgiven_in_half_a_second() -> None:
    balance = TurnBalance()
    walked(balance, range(100), 1, RIGHT, NONE)
    said = walked(balance, range(100, 160), 1, RIGHT, np.array([0.0, 0.09, 0.0]))
    assert said.index(True) < 16
    assert all(said[said.index(True) :])
    said = walked(balance, range(160, 260), 1, RIGHT, NONE)
    assert 4 <= said.index(False) <= 10
    assert not any(said[said.index(False) :])


def test_what_is_interrupted_is_not_forgiven_in_pieces() -> None:
    balance = TurnBalance()
    walked(balance, range(100), 1, RIGHT, NONE)
    walked(balance, range(100, 120), 1, -RIGHT, NONE)
    for k in range(120, 160, 4):
        assert all(walked(balance, range(k, k + 4), 1, RIGHT, NONE))
        balance.interrupt()


def test_nothing_is_said_before_the_usual_difference_is_known() -> None:
    balance = TurnBalance(TurnBalanceSettings(known_s=1.0))
    assert not any(walked(balance, range(15), 1, -RIGHT, NONE))
