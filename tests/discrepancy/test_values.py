"""A simulation is given every parameter, neutral where nobody set it, and no misspelt name passes anywhere."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.own_simulation import OwnSimulation
from discrepancy.problem import Problem
from discrepancy.restricted import without
from discrepancy.simulation import Values
from discrepancy.values import Neutral, predicted
from messages.arrays import FloatArray
from messages.errors import UserError
from tests.bench.explained import DELAY, MASS, OFFSET, Toy, toy

KEYS = ["mass_kg", "force_delay.value_s", "tare_error.fx_n", "tare_error.tz_nm"]


@dataclass(frozen=True)
class Watched(Toy):
    """The toy, which remembers what it was given."""

    given: list[dict[str, float]] = field(default_factory=list)

    def predicted(self, values: Values) -> FloatArray:
        self.given.append(dict(values))
        return super().predicted(values)


def test_every_call_of_the_search_is_given_every_parameter() -> None:
    fit, held_out = (Watched(toy(seed).channels) for seed in (1, 2))
    found = explain(fit, held_out, seed=1)
    assert [cause.name for cause in found.verdict.causes] == ["force_delay"]
    assert len(fit.given) > 10
    assert all(list(given) == KEYS for given in (*fit.given, *held_out.given))
    assert list(found.values_after) == KEYS
    assert found.values_after["tare_error.fx_n"] == 0.0


def test_what_is_left_out_is_neutral_even_where_that_is_infinite() -> None:
    limit = replace(OFFSET, parameters=(replace(OFFSET.parameters[0], neutral=np.inf), OFFSET.parameters[1]))
    watched = Watched(toy(1).channels, effects=(DELAY, limit))
    Problem(watched).predicted({"mass_kg": 3.0})
    assert watched.given[-1] == {"mass_kg": 3.0, "force_delay.value_s": 0.0, KEYS[2]: np.inf, KEYS[3]: 0.0}
    assert watched.given[0]["mass_kg"] == MASS.neutral


def test_a_library_taken_apart_still_gives_the_whole_simulation_everything() -> None:
    watched = Watched(toy(1).channels)
    predicted(without(watched, ["tare_error"]), {"force_delay.value_s": 1e-3})
    assert list(watched.given[-1]) == KEYS


def test_an_unknown_key_is_refused_before_the_simulation_is_called() -> None:
    watched = Watched(toy(1).channels)
    problem = Problem(watched)
    calls = len(watched.given)
    for call in (lambda values: predicted(watched, values), problem.predicted, problem.residual):
        with pytest.raises(UserError) as refused:
            call({"mass_kg": 2.0, "force_delay.value": 1e-3})
        assert str(refused.value) == (
            "toy: parameter force_delay.value is unknown; the nearest known is force_delay.value_s"
        )
    assert len(watched.given) == calls


@pytest.mark.parametrize("read", [lambda v: v["tare_error.fx"], lambda v: v.get("tare_error.fx", 0.0)])
def test_a_model_that_reads_a_misspelt_parameter_is_told_so(read: object) -> None:
    channels = toy(1).channels

    def model(values: Values) -> FloatArray:
        return np.full(channels.values.shape, read(values))  # type: ignore[operator]

    with pytest.raises(UserError, match=r"own: parameter tare_error\.fx is unknown; .* tare_error\.fx_n$"):
        explain(OwnSimulation("own", channels, model, (DELAY, OFFSET)), None, seed=1)


def test_an_effect_cannot_name_parameters_that_it_has_not() -> None:
    with pytest.raises(UserError, match=r"effect tare_error: starts: fx is unknown; the nearest known is fx_n"):
        replace(OFFSET, starts=({"fx": 1.0},))
    with pytest.raises(UserError, match=r"effect tare_error: choices: tz_n is unknown; the nearest known is tz_nm"):
        replace(OFFSET, choices=(("fx_n", "tz_n"),))


def test_a_key_that_two_share_is_refused() -> None:
    with pytest.raises(UserError, match=r"toy: parameter force_delay\.value_s is there twice"):
        Neutral(Toy(toy(1).channels, effects=(DELAY, OFFSET, DELAY)))
