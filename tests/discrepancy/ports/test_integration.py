"""The integrator: exact where the answer is known, the same for one set of parameters as for many, and as a loop."""

import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from discrepancy.ports import marching, simulation, trajectories
from discrepancy.ports.acting import Batch, Named, leaders
from discrepancy.ports.declared import Act, Arrays, PortTerm, Rows, Signal, SignalTerm
from discrepancy.ports.ode import Ode, Whole
from discrepancy.ports.trajectories import Trajectories
from discrepancy.simulation import Channels, Effect, Parameter
from messages.arrays import FloatArray
from messages.errors import UserError
from tests.bench.ported import MODEL, SLED, derivative, sled


def effect(name: str) -> Effect:
    return Effect(name, (Parameter("value", "1", 0.0, -10.0, 10.0, 0.01),), "It is there.", "Remove it.", "Look.")


def lagged(signals: Rows, own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
    return -p["value"] * own[0], ((signals[1] - own[0]) / 0.1,)


def rubbed(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
    return -p["value"] * np.tanh(signals[1] / 0.05), ()


def raised(signals: Rows, _channels: Channels, p: Arrays) -> FloatArray:
    return signals[0] + p["value"]


TERMS = (
    PortTerm("sled", effect("lagged"), lagged, memory=1),
    PortTerm("sled", effect("rubbed"), rubbed),
    SignalTerm("output", "place_m", effect("raised"), raised),
)


def test_a_decay_is_the_exponential() -> None:
    decay = Ode(start=(1.0,), derivative=lambda state, *_: (-0.5 * state[0],), output=(0,))
    batch = Batch(0.1, np.zeros((0, 1, 400)), Named(), (), (), 0, np.arange(1), ({},), Trajectories())
    found = decay.outputs(batch)[0][0]
    assert np.allclose(found, np.exp(-0.05 * np.arange(400)), rtol=1e-6)


def _ringing(per_s: float, steps: int = 0) -> simulation.PortedSimulation:
    """Return an oscillator that rings `per_s` times a second, seen at 100 Hz."""
    w2 = (2.0 * np.pi * per_s) ** 2

    def rates(state: Rows, inputs: Rows, values: Arrays, _act: Act) -> tuple[FloatArray, ...]:
        return state[1], w2 * (inputs[0] - state[0]) - 2.0 * values["damping"] * state[1]

    t_s = np.arange(600) / 100.0
    push = (t_s < 0.5).astype(np.float64)[:, None]
    channels = Channels(t_s, np.zeros((600, 1)), ("place_m",), push, ("push_m",))
    damping = Parameter("damping", "1/s", 1.0, 0.0, 10.0, 0.01)
    model = Ode(start=(0.0, 0.0), derivative=rates, output=(0,), steps=steps)
    return simulation.PortedSimulation("ringing", channels, model, (), (damping,))


@pytest.mark.parametrize("per_s", [0.5, 4.0, 8.0, 12.0])
def test_a_model_that_is_fast_has_as_many_steps_as_it_needs(per_s: float) -> None:
    found, exact = (_ringing(per_s, steps).predicted({}) for steps in (0, 64))
    assert np.sqrt(np.mean((found - exact) ** 2)) < 2e-3 * exact.std()
    once = _ringing(per_s, 1).predicted({})
    assert bool(np.sqrt(np.mean((once - exact) ** 2)) > 2e-3 * exact.std()) is (per_s > 4.0)


def test_steps_are_no_more_than_asked_for_or_than_bring_anything() -> None:
    def steps(each: simulation.PortedSimulation) -> int:
        assert isinstance(each.stepped, Ode)
        return each.stepped.steps

    assert steps(_ringing(0.5)) == 1
    assert steps(_ringing(12.0, 1)) == 1
    kinks = replace(
        MODEL, derivative=lambda x, u, p, act: (np.sign(np.sin(x[0] / 3e-4)), *derivative(x, u, p, act)[1:])
    )
    assert steps(replace(sled(1), model=kinks)) <= 2
    assert steps(sled(1).with_terms(())) == steps(sled(1)) == 1


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(range(3)), st.floats(0.01, 1.0)), min_size=1, max_size=6))
def test_many_sets_give_what_each_gives_alone(drawn: list[tuple[int, float]]) -> None:
    whole = sled(1, 300, TERMS)
    sets = [{TERMS[k].effect.qualified("value"): value} for k, value in drawn]
    together = whole.predicted_many(sets)
    for each, values in zip(together, sets, strict=True):
        assert np.allclose(each, whole.predicted(values), rtol=1e-9, atol=1e-9)


def test_windows_give_what_a_loop_over_samples_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = sled(1, 300, TERMS)
    values = {"lagged.value": 0.4, "rubbed.value": 0.7}
    fast = whole.predicted(values)
    monkeypatch.setattr(marching, "_window", lambda *_: None)
    assert np.allclose(fast, whole.predicted(values), rtol=1e-9, atol=1e-9)


def test_a_set_is_near_to_the_first_that_differs_in_two_parameters_at_most() -> None:
    here = {"damping": 3.0, "mass_kg": 2.0, "rubbed.value": 0.5}
    moved = [{**here, key: 1.01 * value} for key, value in here.items()]
    other = {"damping": 1.0, "mass_kg": 1.0, "rubbed.value": 0.1}
    assert leaders([here, *moved, other, {**other, "damping": 1.01}, {}]).tolist() == [0, 0, 0, 0, 4, 4, 6]


def test_what_begins_near_is_the_same_and_takes_fewer_evaluations(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def counting(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        asked.append(state[0].size)
        return derivative(state, inputs, values, act)

    whole = replace(sled(1, 300, TERMS), model=replace(MODEL, derivative=counting, steps=1))
    here = {"lagged.value": 0.4, "rubbed.value": 0.7}
    sets = [{**here, key: value + change} for key, value in here.items() for change in (1e-3, -1e-3, 2e-3, 0.02)]
    near = whole.predicted_many(sets)
    taken = sum(asked)
    asked.clear()
    monkeypatch.setattr(simulation, "leaders", lambda sets: np.arange(len(sets)))
    assert np.allclose(near, replace(whole).predicted_many(sets), rtol=1e-9, atol=1e-9)
    assert taken < 0.8 * sum(asked)


def test_what_was_solved_near_is_begun_with_and_changes_nothing() -> None:
    asked: list[int] = []

    def counting(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        asked.append(state[0].size)
        return derivative(state, inputs, values, act)

    whole = replace(sled(1, 300, TERMS), model=replace(MODEL, derivative=counting, steps=1))
    begun, next_to = ({"lagged.value": 0.4, "rubbed.value": value} for value in (0.7, 0.72))
    whole.predicted(begun)
    asked.clear()
    near = whole.predicted(next_to)
    taken = sum(asked)
    asked.clear()
    assert np.allclose(near, replace(whole).predicted(next_to), rtol=1e-9, atol=1e-9)
    assert taken < 0.8 * sum(asked)
    assert not pickle.loads(pickle.dumps(whole._solved)).near((), [begun], np.zeros((1, 1)), 300)


def test_a_trajectory_is_not_taken_for_one_with_other_states() -> None:
    """Beside a set with two memories one that needs the first alone has room for both."""
    whole = sled(1, 300, (*TERMS, PortTerm("sled", effect("slow"), lagged, memory=1)))
    alone = {"lagged.value": 0.41}
    whole.predicted_many([{"lagged.value": 0.4}, {"lagged.value": 0.4, "slow.value": 0.1}])
    assert np.allclose(whole.predicted(alone), replace(whole).predicted(alone), rtol=1e-9, atol=1e-9)


def test_trajectories_are_kept_as_far_as_there_is_room(monkeypatch: pytest.MonkeyPatch) -> None:
    solved, path = Trajectories(), np.ones((2, 1, 100))
    monkeypatch.setattr(trajectories, "_MOST_BYTES", 3 * path.nbytes)
    for name in "abcd":
        solved.keep((), [{name: 1.0}], path)
    assert [solved.near((), [{name: 1.1}], np.zeros((2, 1)), 100) is not None for name in "abcd"] == [
        False,
        True,
        True,
        True,
    ]
    for value in range(9):
        solved.keep((), [{"d": float(value)}], value * path)
    found = solved.near((), [{"d": 7.9}, {"unknown": 1.0}], np.full((2, 2), 5.0), 100)
    assert found is not None
    assert (found.path[0, 0, 0], found.path[0, 1, 0]) == (8.0, 5.0)
    solved.keep((), [{"e": 1.0}], np.nan * path)
    assert solved.near((), [{"e": 1.0}], np.zeros((2, 1)), 100) is None


def test_a_set_that_diverges_leaves_the_others_alone() -> None:
    whole = sled(1, 300, TERMS)
    wild, calm = whole.predicted_many([{"damping": -400.0}, {}])
    assert not np.isfinite(wild).all()
    assert np.allclose(calm, whole.predicted({}), rtol=1e-9, atol=1e-9)


def test_inputs_go_straight_to_the_next_sample_where_they_are_not_held() -> None:
    step_s, n = 0.1, 50
    ramp = np.broadcast_to(np.arange(n) * step_s, (1, 1, n))
    for held, at_once in ((True, step_s / 2.0), (False, 0.0)):
        follow = Ode(start=(0.0,), derivative=lambda _, inputs, *__: (inputs[0],), output=(0,), held=held)
        found = follow.outputs(Batch(step_s, ramp, Named(), (), (), 0, np.arange(1), ({},), Trajectories()))[0][0]
        t_s = np.arange(n) * step_s
        assert np.allclose(found, 0.5 * t_s**2 - at_once * t_s)


def test_whole_signals_have_ports_too() -> None:
    def model(inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, FloatArray]:
        (force,) = inputs
        place = force / 3.0
        speed = np.gradient(place, axis=1)
        return place + act("sled", place, speed), speed * values["damping"]

    whole = replace(sled(1, 300, TERMS), model=Whole(model))
    one = whole.predicted({"lagged.value": 0.5})
    assert np.ptp(one[:, 0] - whole.predicted({})[:, 0]) > 1e-3
    assert np.allclose(one, whole.predicted_many([{}, {"lagged.value": 0.5}])[1])


def calling(port: str, count: int) -> Callable[[Rows, Rows, Arrays, Act], tuple[FloatArray, ...]]:
    def wrong(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        act(port, *[state[0]] * count)
        return derivative(state, inputs, values, act)

    return wrong


@pytest.mark.parametrize(
    ("port", "count", "line"),
    [("sledd", 2, "act: port sledd is unknown; the nearest known is sled"), ("sled", 1, "1 signals; expected the 2")],
)
def test_a_wrong_call_of_a_port_is_told(port: str, count: int, line: str) -> None:
    with pytest.raises(UserError, match=line):
        replace(sled(1, 300), model=replace(MODEL, derivative=calling(port, count))).predicted({})


def test_a_port_that_is_never_asked_is_told() -> None:
    silent = replace(MODEL, derivative=lambda state, *_: (state[1], -state[0]))
    whole = replace(sled(1, 300), model=silent)
    with pytest.raises(UserError, match="port sled: the model never calls act there"):
        _ = whole.library


def test_a_model_that_diverges_from_its_own_values_is_told() -> None:
    wild = replace(sled(1, 300).parameters[1], neutral=-400.0, low=-500.0)
    whole = replace(sled(1, 300), parameters=(sled(1, 300).parameters[0], wild))
    with pytest.raises(UserError, match=r"no finite output from .* s on"):
        _ = whole.library


def test_a_parameter_that_is_not_there_is_told() -> None:
    asks = replace(MODEL, derivative=lambda _state, _inputs, values, _act: (values["masss_kg"],))
    with pytest.raises(UserError, match="parameter masss_kg is unknown; the nearest known is mass_kg"):
        replace(sled(1, 300, TERMS), model=asks).predicted({})


def test_a_port_is_named_as_effects_are() -> None:
    with pytest.raises(UserError, match="expected a name of letters, digits and underscores"):
        replace(SLED, name="the sled", signals=(Signal("place", "m"),))


def pulled(_signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
    return p["value"], ()


def test_terms_at_one_port_add_up() -> None:
    one, other = PortTerm("sled", effect("one"), pulled), PortTerm("sled", effect("other"), pulled)
    whole = sled(1, 300, (one, other))
    plain, first, second, both = whole.predicted_many(
        [{}, {"one.value": 0.5}, {"other.value": 0.3}, {"one.value": 0.5, "other.value": 0.3}]
    )
    assert np.allclose(both - plain, (first - plain) + (second - plain), atol=1e-9)
    assert np.ptp(both - first) > 1e-3
