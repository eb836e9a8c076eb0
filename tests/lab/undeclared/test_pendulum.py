"""A pendulum whose noise nobody declared: what is missing in its model is not taken for the colour of noise."""

import pytest

from discrepancy import Explanation, explain
from lab.hidden.pendulum import drawn
from lab.undeclared.pendulum import simulation


def explained(effect: str, withheld: tuple[str, ...] = (), size: float = 1.0) -> Explanation:
    fit, held_out = (simulation(drawn(seed, effect, size=size), withheld) for seed in (11, 511))
    return explain(fit, held_out, seed=1)


@pytest.mark.parametrize(("effect", "size"), [("cogging", 1.0), ("coulomb", 0.3), ("drag", 1.0)])
def test_a_withheld_effect_behind_the_dynamics_is_unknown(effect: str, size: float) -> None:
    verdict = explained(effect, (effect,), size).verdict
    assert verdict.verdict == "unknown"
    assert verdict.remainder.present


def test_an_effect_of_the_library_is_named_with_its_size() -> None:
    cause = explained("cogging").verdict.causes[0]
    assert cause.name == "cogging"
    told = cause.parameters["value"]
    assert told.low is not None
    assert told.high is not None
    assert told.low < 0.08 < told.high


def test_noise_alone_is_nothing() -> None:
    assert explained("").verdict.verdict == "nothing"
