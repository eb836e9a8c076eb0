"""Noise is known from what was stated, from repeats, from a periodic input and from a rest; otherwise it is not."""

import numpy as np
import pytest

from discrepancy.evidence.noise import known_noise, repeated
from discrepancy.simulation import Channels
from messages.arrays import FloatArray
from tests.bench.linear_bench import autoregressive

_N, _STD = 3000, 0.2


def channels(inputs: FloatArray, seed: int, noise_std: float | None = None) -> Channels:
    """Return a recording (n, 1) that follows its input (n,) by a law that no model need know, with noise."""
    rng = np.random.default_rng(seed)
    follows = np.convolve(inputs, np.exp(-np.arange(60) / 8.0))[: len(inputs)] + 0.5 * inputs**2
    measured = follows + rng.normal(0.0, _STD, len(inputs))
    stated = None if noise_std is None else np.array([noise_std])
    return Channels(np.arange(len(inputs)) / 100.0, measured[:, None], ("y",), inputs[:, None], ("u",), stated)


def drawn(n: int, seed: int = 1) -> FloatArray:
    return np.asarray(autoregressive(np.random.default_rng(seed), (1, n), (0.9,))[0])


def test_what_is_stated_is_believed() -> None:
    told = known_noise(channels(np.tile(drawn(500), 6), 1, noise_std=0.7))
    assert told is not None
    assert (told.source, told.std.tolist(), told.whole) == ("stated", [0.7], True)


def test_a_periodic_input_tells_all_the_noise() -> None:
    told = known_noise(channels(np.tile(drawn(500), 6), 1))
    assert told is not None
    assert told.source == "period"
    assert told.whole
    assert told.std[0] == pytest.approx(_STD, rel=0.06)


def test_two_recordings_of_one_input_tell_all_the_noise_and_of_two_inputs_none() -> None:
    u = drawn(_N)
    told = repeated(channels(u, 1), channels(u, 2))
    assert told is not None
    assert told.source == "repeats"
    assert told.std[0] == pytest.approx(_STD, rel=0.06)
    assert repeated(channels(u, 1), channels(drawn(_N, 2), 2)) is None
    assert repeated(channels(u, 1), channels(u, 1)) is None  # the same recording twice


def test_a_rest_tells_the_noise_that_motion_does_not_make() -> None:
    told = known_noise(channels(np.concatenate((drawn(_N), np.zeros(600))), 1))
    assert told is not None
    assert told.source == "rest"
    assert not told.whole
    assert told.std[0] == pytest.approx(_STD, rel=0.12)


def test_a_step_after_which_something_still_moves_is_no_rest() -> None:
    slow = channels(np.concatenate((drawn(_N), np.zeros(600))), 1)
    slow.values[_N:, 0] += 4.0 * np.exp(-np.arange(600) / 400.0)
    assert known_noise(slow) is None


def test_an_input_that_never_repeats_nor_rests_tells_nothing() -> None:
    assert known_noise(channels(drawn(_N), 1)) is None
    assert known_noise(channels(np.sin(np.arange(_N) / 700.0), 1)) is None
    assert known_noise(channels(np.ones(_N), 1)) is None
