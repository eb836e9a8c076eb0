"""Simulations that diverge, parameters that do nothing, causes that undo each other, and many causes at once."""

import numpy as np
import pytest

from discrepancy import Explanation, explain
from discrepancy.own_simulation import OwnSimulation
from discrepancy.problem import Problem
from discrepancy.report.wording import seen_text
from discrepancy.search.candidates import Candidate
from discrepancy.search.equivalents import better
from discrepancy.search.fit import Fit
from discrepancy.search.search import Search
from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray
from tests.bench.discrepancy_bench import EFFECTS, Path, Rig, coloured, measured
from tests.bench.linear_bench import Columns, LinearSimulation, autoregressive

_N = 1500


def effect(name: str, **options: object) -> Effect:
    return Effect(name, (Parameter("value", "1", 0.0, -10.0, 10.0, 1e-3),), "", "", "", **options)  # type: ignore[arg-type]


def own(seed: int, effects: tuple[Effect, ...], tolerance: float | None = None) -> OwnSimulation:
    """Return a simulation that says 0 where 0.5 u was measured, with effects that misbehave, in noise of 0.2."""
    rng = np.random.default_rng(seed)
    u = autoregressive(rng, (1, _N), (0.8,))[0]
    y = 0.5 * u + rng.normal(0.0, 0.2, _N)

    def model(values: Values) -> FloatArray:
        told = dict(values.items())
        assert all(np.isfinite(each) for each in told.values())
        out = told.get("slope.value", 0.0) * u
        if "explosion.value" in told:
            with np.errstate(all="ignore"):
                out = out + np.sinh(300.0 * told["explosion.value"] * u)
        if told.get("cliff.value", 0.0) > 1.0:
            out = np.where(np.arange(_N) < 0.2 * _N, out, np.nan)
        return np.asarray(out)[:, None]

    allowed = None if tolerance is None else np.array([tolerance])
    channels = Channels(np.arange(_N) / 100.0, y[:, None], ("y",), u[:, None], ("u",), None, allowed)
    return OwnSimulation("own", channels, model, effects)


def told(*effects: Effect, tolerance: float | None = None) -> Explanation:
    return explain(own(1, effects, tolerance), own(2, effects, tolerance), seed=1)


def test_a_parameter_without_influence_and_a_diverging_start_change_nothing() -> None:
    cliff = effect("cliff", starts=({}, {"value": 2.0}))
    found = told(effect("slope"), effect("idle"), cliff, effect("explosion"))
    assert [cause.name for cause in found.verdict.causes] == ["slope"]
    assert found.verdict.causes[0].parameters["value"].value == pytest.approx(0.5, abs=0.02)
    assert not any("gives" in note for note in found.notes)


def test_what_diverges_from_the_beginning_is_refused_or_told() -> None:
    problem = Problem(own(1, (effect("cliff"),)))
    search = Search(problem, ["cliff"], 1)
    assert problem.valid.mean() > 0.98
    assert search.refits.fitted({"cliff.value": 2.0}, ("cliff.value",)).chi2 == np.inf


def test_what_meets_the_stated_tolerance_needs_no_cause() -> None:
    assert told(effect("slope")).verdict.verdict == "named"
    good = told(effect("slope"), tolerance=2.0).verdict
    assert (good.verdict, good.causes) == ("nothing", [])
    assert "tolerance" in good.notes[0]


def test_nothing_says_from_which_size_on_it_would_have_been_seen() -> None:
    rng = np.random.default_rng(4)
    u, noise = autoregressive(rng, (1, _N), (0.5,))[0], rng.normal(size=_N)

    def recording(size: float, loud: float = 1.0) -> LinearSimulation:
        library = [Columns("slope", {"value": u[:, None]}, bounds=(-5.0, 5.0))]
        return LinearSimulation((size * u + loud * noise)[:, None], u[:, None], library=library)

    least = explain(recording(0.0), recording(0.0), seed=1).verdict
    assert least.verdict == "nothing"
    size = least.seen_above["slope.value"].value
    assert size is not None
    assert explain(recording(1.3 * size), recording(1.3 * size), seed=1).verdict.verdict == "named"
    assert explain(recording(0.4 * size), recording(0.4 * size), seed=1).verdict.verdict == "nothing"
    assert seen_text(least) == f"slope {size:.2g}"
    deaf = explain(recording(0.0, 100.0), recording(0.0, 100.0), seed=1).verdict
    assert deaf.verdict == "cannot_tell"
    assert deaf.seen_above["slope.value"].value is None
    assert seen_text(deaf) == "slope at no size within its bounds"
    assert "times as strong" in (deaf.next_experiment or "")


def rig(*causes: str, seed: int = 1) -> Rig:
    rng = np.random.default_rng(seed)
    path = Path.drawn(rng)
    still = measured(path, "", 1.0, 3000)
    truth = still + sum(measured(path, cause, 1.0, 3000) - still for cause in causes)
    return Rig(path, truth + coloured(rng, 3000, 0.3, 0.5))


@pytest.mark.long
def test_four_causes_at_once() -> None:
    causes = ("delay", "coulomb", "offset", "damping")
    found = explain(rig(*causes, seed=3), rig(*causes, seed=4), seed=1)
    assert {cause.name for cause in found.verdict.causes} == set(causes)


def test_a_delay_and_an_advance_cancel_and_two_delays_do_not() -> None:
    search = Search(Problem(rig()), [each.name for each in EFFECTS], 1)
    refits = search.refits
    pair = [next(c for c in refits.candidates if c.effect == name) for name in ("delay", "lag")]
    for delay_s, cancel in ((-4e-3, True), (4e-3, False)):
        values = {**refits.base.values, "delay.value_s": delay_s, "lag.tau_s": 4e-3}
        keys = ("delay.value_s", "lag.tau_s")
        assert refits.cancel(refits.fitted(values, keys, steps=0), pair) is cancel


def test_a_rival_that_fits_better_takes_the_cause_s_place() -> None:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(2, 1000))
    worse, good = x[0] + 0.3 * x[1], x[0]
    library = [Columns(name, {"p": row[:, None]}) for name, row in (("worse", worse), ("good", good))]
    simulation = LinearSimulation((good + rng.normal(size=1000))[:, None], x.T, library=library)
    search = Search(Problem(simulation), ["worse", "good"], 1)
    cause = next(c for c in search.refits.candidates if c.effect == "worse")
    exchanged = better(search, search.refits.joined(search.refits.base, cause), (cause,))
    assert exchanged is not None
    assert [each.effect for each in exchanged[1]] == ["good"]


def test_one_cause_that_imitates_two_is_exchanged_for_both() -> None:
    rng = np.random.default_rng(5)
    strong, one, two, nothing = np.linalg.qr(rng.normal(size=(1000, 4)))[0].T * np.sqrt(1000.0)
    rows = {"strong": strong, "imitation": 1.3 * one + two + 0.2 * nothing, "one": one, "two": two}
    library = [Columns(name, {"p": row[:, None]}) for name, row in rows.items()]
    measured_ = 1.75 * strong + 1.3 * one + two + rng.normal(size=1000)
    simulation = LinearSimulation(measured_[:, None], np.stack((one, two), axis=1), library=library)
    found = Search(Problem(simulation), list(rows), 1).found()
    assert {each.effect for each in found.causes} == {"strong", "one", "two"}


def test_two_causes_of_many_parameters_do_not_take_the_place_of_one_that_says_nearly_as_much() -> None:
    rng = np.random.default_rng(5)
    strong, *parts, nothing = np.linalg.qr(rng.normal(size=(1000, 6)))[0].T * np.sqrt(1000.0)
    one = 0.8 * sum(parts) + 0.2 * nothing
    library = [
        Columns("strong", {"p": strong[:, None]}),
        Columns("one", {"p": one[:, None]}),
        Columns("left", {"a": parts[0][:, None], "b": parts[1][:, None]}),
        Columns("right", {"a": parts[2][:, None], "b": parts[3][:, None]}),
    ]
    measured_ = 1.75 * strong + 0.8 * sum(parts) + rng.normal(size=1000)
    simulation = LinearSimulation(measured_[:, None], np.stack(parts, axis=1), library=library)
    found = Search(Problem(simulation), [each.name for each in library], 1).found()
    assert {each.effect for each in found.causes} == {"strong", "one"}


def test_what_was_predicted_is_not_predicted_again() -> None:
    asked: list[float] = []

    def model(values: Values) -> FloatArray:
        asked.append(values["slope.value"])
        return np.full((_N, 1), values["slope.value"])

    channels = Channels(np.arange(_N) / 100.0, np.zeros((_N, 1)), ("y",), np.zeros((_N, 1)), ("u",))
    problem = Problem(OwnSimulation("own", channels, model, (effect("slope"), effect("idle"))))
    begun = len(asked)
    first = problem.predicted({"slope.value": 1.0})
    again = [*problem.predicted_many([{"slope.value": 1.0, "idle.value": 0.0}, {"slope.value": 2.0}])]
    assert asked[begun:] == [1.0, 2.0]
    assert np.array_equal(first, again[0])
    assert not first.flags.writeable


def test_after_a_swap_the_names_are_those_of_the_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    search = Search(Problem(rig()), [effect.name for effect in EFFECTS], 1)
    by_effect = {each.effect: each for each in search.refits.candidates}
    first, second, third, fourth = list(by_effect.values())[:4]

    def fit(chi2: float, *causes: Candidate) -> Fit:
        keys = tuple(key for cause in causes for key in cause.keys)
        return Fit(dict.fromkeys(keys, 0.0), np.sqrt(chi2) * search.refits.base.residual, chi2, keys)

    swaps = [(0, third, fit(90.0, third, second)), (1, fourth, fit(20.0, first, fourth))]
    monkeypatch.setattr(search, "rivals", lambda *_: swaps)
    monkeypatch.setattr(search.refits, "cancel", lambda *_: False)
    best, causes = search._swapped(fit(1000.0, first, second), (first, second))
    assert {key.split(".")[0] for key in best.keys} == {each.effect for each in causes}
