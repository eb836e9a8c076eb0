"""Adequacy: noise of any colour and level passes as often as claimed, and what follows from the inputs is found, told
in words, and of the true size.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.signal import lfilter

from discrepancy.evidence.adequacy import LEVEL, Left, adequacy, grown, left
from discrepancy.evidence.probe import Predictable, Probe
from discrepancy.evidence.whitening import whitening
from discrepancy.explanation import Adequacy
from discrepancy.problem import Problem
from messages.arrays import FloatArray
from tests.bench.linear_bench import FALSE_FAILURE, LinearSimulation, autoregressive, likely_counts

_SEED = 7302
_DRAWS = 500
_N = 300
_SLOW = 0.95
_FLIPS = 150
"""Draws of random signs, beside which the residual's own is one more: a chance is a multiple of 1/151."""


def judged(
    noise: FloatArray,
    inputs: FloatArray,
    predicted: FloatArray,
    noise_std: float | None = None,
    elsewhere: float = 0.0,
    signal: FloatArray | float = 0.0,
    seed: int = 1,
) -> tuple[Adequacy, Predictable]:
    """Return what is said of noise and `signal` (c, n) under inputs (k, n) and a prediction (c, n)."""
    declared = None if noise_std is None else np.full(len(noise), noise_std)
    problem = Problem(LinearSimulation((signal + noise).T, inputs.T, noise_std=declared))
    white = whitening(noise, problem.valid)
    residual = problem.residual({})
    here = left(problem, white, Probe(problem, white, predicted, residual, seed), residual)
    return adequacy(here, with_chance(here, elsewhere))


def with_chance(here: Left, chance: float) -> Left:
    """Return another recording of which only the chance of what the inputs predict is known."""
    return replace(here, predictable=replace(here.predictable, chance=chance), line=None)


@lru_cache
def noises(kind: str) -> list[Adequacy]:
    """Return what is said of 500 recordings of noise alone: white, or slow and driven more by a larger input."""
    rng = np.random.default_rng(_SEED)
    out = []
    for draw in range(_DRAWS):
        inputs = autoregressive(rng, (1, _N), (0.9,))
        predicted = autoregressive(rng, (1, _N), (0.9,))
        noise = rng.normal(size=(1, _N))
        if kind == "slow and growing":
            noise = np.asarray(lfilter([1.0], [1.0, -_SLOW], noise * (0.3 + np.abs(inputs))))
        out.append(judged(noise, inputs, predicted, seed=draw)[0])
    return out


@pytest.mark.long
@pytest.mark.parametrize("kind", ["white", "slow and growing"])
def test_chance_of_noise_is_uniform(kind: str) -> None:
    chances = np.array([each.chance for each in noises(kind)])
    for level in (0.01, 0.1, 0.4):
        reached = int(np.sum(chances <= level))
        least, most = likely_counts(_DRAWS, int(level * (_FLIPS + 1)) / (_FLIPS + 1), FALSE_FAILURE / 3.0)
        assert least <= reached <= most, f"seed {_SEED}: {reached} of {_DRAWS} chances are at most {level}"


@pytest.mark.long
@pytest.mark.parametrize("kind", ["white", "slow and growing"])
def test_noise_alone_is_adequate(kind: str) -> None:
    # Once in a hundred recordings something follows from the inputs by chance, once in a thousand there is a line.
    refused = [each.reasons for each in noises(kind) if not each.adequate]
    assert len(refused) <= likely_counts(_DRAWS, 0.011)[1], f"seed {_SEED}: {refused}"


class NothingFollows(Probe):
    """Finds nothing that follows from the inputs, at no cost, so that other reasons can be counted over many draws."""

    def __init__(self) -> None: ...

    def predictable(self, residual: FloatArray) -> Predictable:
        return Predictable(np.zeros_like(residual), np.zeros(len(residual)), 1.0, ())


@pytest.mark.long
def test_noise_as_declared_is_louder_once_in_a_thousand_recordings_however_slow() -> None:
    rng = np.random.default_rng(_SEED)
    draws = 2000
    std = 1.0 / np.sqrt(1.0 - _SLOW**2)
    levels, refused = np.zeros(draws), 0
    for draw, noise in enumerate(autoregressive(rng, (draws, 1, _N), (_SLOW,))):
        problem = Problem(LinearSimulation(noise.T, noise.T, noise_std=np.array([std])))
        told = adequacy(left(problem, whitening(noise, problem.valid), NothingFollows(), noise), None)[0]
        levels[draw] = told.level[0]
        refused += any("declared" in reason for reason in told.reasons)
    assert refused <= likely_counts(draws, 0.001)[1], f"seed {_SEED}: {refused} of {draws}"
    assert np.sum(levels > LEVEL) > 0.02 * draws  # by chance: a plain comparison would refuse these


@pytest.mark.long
def test_noise_that_grows_with_the_input_is_told_from_steady_noise() -> None:
    steady = np.array([each.heteroscedasticity[0] for each in noises("white")])
    growing = np.array([each.heteroscedasticity[0] for each in noises("slow and growing")])
    assert abs(steady.mean()) < 4.0 * steady.std() / np.sqrt(_DRAWS), f"seed {_SEED}"
    assert steady.std() < 0.25
    assert np.quantile(growing, 0.1) > np.quantile(steady, 0.9)


def motion(n: int = 800) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return two inputs (2, n), a predicted output (1, n) of another source, and unit white noise (1, n)."""
    rng = np.random.default_rng(_SEED)
    return autoregressive(rng, (2, n), (0.9,)), autoregressive(rng, (1, n), (0.9,)), rng.normal(size=(1, n))


def planted(group: str, inputs: FloatArray, predicted: FloatArray) -> FloatArray:
    """Return what follows from inputs and prediction in a way that only one group of functions holds, (1, n)."""
    n = inputs.shape[1]
    out = {
        "time": 2.0 * (np.arange(n) / n - 0.5),
        "lags": np.gradient(inputs[0]),
        "products": inputs[0] * inputs[1],
        "distortions": np.abs(inputs[0]) - np.abs(inputs[0]).mean(),
        "outputs": predicted[0] ** 2 - (predicted[0] ** 2).mean(),
    }[group]
    return np.asarray(out / out.std())[None]


@pytest.mark.parametrize("group", ["time", "lags", "products", "distortions", "outputs"])
def test_what_follows_from_the_inputs_is_found_with_its_kind_and_size(group: str) -> None:
    inputs, predicted, noise = motion()
    truth = 0.8 * planted(group, inputs, predicted)
    told, found = judged(noise, inputs, predicted, signal=truth)
    assert told.chance == 1.0 / (_FLIPS + 1)
    assert found.groups[0] == group
    assert not told.adequate
    assert group in told.reasons[0]
    assert np.std(found.signal - truth) < 0.35 * np.std(truth)


def test_the_share_of_white_noise_and_white_signal_is_that_of_their_powers() -> None:
    rng = np.random.default_rng(_SEED)
    inputs = rng.normal(size=(1, 4000))
    told, _ = judged(rng.normal(size=(1, 4000)), inputs, inputs, signal=0.5 * inputs)
    assert told.predictable[0] == pytest.approx(0.25 / 1.25, abs=0.03)


def test_only_the_channel_that_follows_from_the_inputs_has_a_share() -> None:
    inputs, predicted, noise = motion()
    noises_ = np.concatenate((np.random.default_rng(3).normal(size=noise.shape), noise))
    signal = np.concatenate((0.0 * noise, planted("products", inputs, predicted)))
    told, found = judged(noises_, inputs, np.repeat(predicted, 2, axis=0), signal=signal)
    assert told.predictable[0] < 0.01
    assert told.predictable[1] > 0.3
    assert "y1" in told.reasons[0]
    assert np.std(found.signal[0]) < 0.1


def test_little_is_believed_only_if_it_is_missing_on_another_recording_too() -> None:
    inputs, predicted, noise = motion(4000)
    signal = 0.18 * planted("products", inputs, predicted)
    there = judged(noise, inputs, predicted, elsewhere=0.1, signal=signal)[0]
    assert 0.01 < there.predictable[0] < 0.05
    assert not there.adequate
    assert judged(noise, inputs, predicted, elsewhere=0.2, signal=signal)[0].adequate


def test_a_line_that_no_input_holds_is_a_reason_and_part_of_the_signal() -> None:
    inputs, predicted, noise = motion()
    hum = 2.0 * np.sin(2.0 * np.pi * 0.23 * np.arange(800))[None]
    told, found = judged(noise, inputs, predicted, signal=hum)
    assert "a line at 23.00 Hz" in " ".join(told.reasons)  # 100 samples a second
    assert np.corrcoef(found.signal[0], hum[0])[0, 1] > 0.9


def test_more_than_the_declared_noise_is_a_reason() -> None:
    inputs, predicted, noise = motion()
    told = judged(noise, inputs, predicted, noise_std=1.0 / 1.7)[0]
    assert told.level[0] == pytest.approx(1.7, rel=0.1)
    assert told.reasons == (f"y0: {told.level[0]:.2f} times the declared noise is left",)
    assert judged(noise, inputs, predicted, noise_std=1.0 / 1.2)[0].adequate
    undeclared = judged(noise, inputs, predicted)[0]
    assert undeclared.adequate
    assert np.isnan(undeclared.level[0])


def test_whiteness_is_the_largest_autocorrelation_to_lag_64() -> None:
    inputs, predicted, noise = motion(300)
    problem = Problem(LinearSimulation(noise.T, inputs.T))
    white = whitening(noise, problem.valid)
    told = adequacy(left(problem, white, Probe(problem, white, predicted, noise, 1), noise), None)[0]
    e = white(noise)[0]
    e /= np.sqrt(np.sum(e**2) / white.count)
    expected = max(abs(sum(e[t] * e[t - lag] for t in range(lag, 300))) / 300 for lag in range(1, 65))
    assert told.whiteness[0] == pytest.approx(expected, rel=1e-9)


def two(noise: FloatArray, inputs: FloatArray, *, tolerance: float | None = None) -> Left:
    """Return what is left of a recording of noise (1, n) alone, under inputs (k, n)."""
    problem = Problem(LinearSimulation(noise.T, inputs.T))
    if tolerance is not None:
        problem.channels = replace(problem.channels, tolerance=np.array([tolerance]))
    return left(problem, whitening(noise, problem.valid), NothingFollows(), noise)


def test_a_faint_line_is_remarked_where_both_recordings_hold_it() -> None:
    inputs, _, noise = motion(4000)
    hum = 0.5 * np.sin(2.0 * np.pi * 0.23 * np.arange(4000))
    here, there = two(noise + hum, inputs), two(noise[:, ::-1] + hum, inputs)
    assert here.line is not None
    assert here.line.share < 0.25
    told = adequacy(here, there)[0]
    assert told.adequate
    assert "a line at 23.00 Hz" in told.remarks[0]
    assert adequacy(here, two(noise, inputs))[0].remarks == ()


def test_what_a_frozen_model_leaves_far_more_of_elsewhere_is_told_in_words() -> None:
    inputs, _, noise = motion()
    assert grown(two(noise, inputs), two(1.4 * noise, inputs)) is None
    assert "4.0 times" in (grown(two(noise, inputs), two(4.0 * noise, inputs)) or "")


def test_what_is_within_the_stated_tolerance_is_good_enough() -> None:
    inputs, _, noise = motion()
    hum = 2.0 * np.sin(2.0 * np.pi * 0.23 * np.arange(800))[None]
    assert not adequacy(two(noise + hum, inputs, tolerance=1.0), None)[0].adequate
    assert adequacy(two(noise + hum, inputs, tolerance=2.5), None)[0].adequate


def test_more_than_the_noise_at_rest_is_a_doubt() -> None:
    inputs, _, noise = motion(4000)
    resting = np.where(np.arange(4000) < 3000, 1.0, 0.2)
    still = inputs * (np.arange(4000) < 3000)
    told = adequacy(two(noise * resting, still), None)[0]
    assert told.adequate
    assert "times the noise at rest" in told.doubts[0]
