"""What leaves at one port and arrives at another: as equations that hold both say, in whatever order a model asks."""

import numpy as np
import pytest

from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Ode, Whole
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Channels
from messages.arrays import FloatArray

N, STEP_S = 300, 0.5
RIM, STIFFNESS, SHARE = 1.2, 0.6, 0.7
VALUES = {
    "overflow_at_upper.limit": RIM,
    "overflow_at_upper.stiffness": STIFFNESS,
    "overflow_at_upper.into_lower": SHARE,
}
PORTS = tuple(Port(name, "m/s", f"the {name} tank", (Signal("level", "m", "level"),)) for name in ("upper", "lower"))
FLOW = 0.12 + 0.1 * np.sin(np.arange(N) * STEP_S * 0.2)


def _cascade(order: tuple[str, str]) -> Ode:
    def levels(state: Rows, inputs: Rows, _values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        level = {"upper": state[0], "lower": state[1]}
        added = {name: act(name, level[name]) for name in order}
        between, out = 0.1 * state[0], 0.2 * state[1]
        return inputs[0] - between + added["upper"], between - out + added["lower"]

    return Ode(start=(1.0, 0.5), derivative=levels, output=(0, 1))


def _explicit(state: Rows, inputs: Rows, _values: Arrays, _act: Act) -> tuple[FloatArray, ...]:
    over = STIFFNESS * np.maximum(state[0] - RIM, 0.0)
    between, out = 0.1 * state[0], 0.2 * state[1]
    return inputs[0] - between - over, between - out + SHARE * over


def _simulation(model: Ode | Whole, ports: tuple[Port, ...] = PORTS) -> PortedSimulation:
    t_s = STEP_S * np.arange(N, dtype=np.float64)
    measured = np.column_stack((1.0 + 0.5 * np.sin(0.1 * t_s), 0.5 + 0.3 * np.sin(0.1 * t_s)))
    channels = Channels(t_s, measured, ("upper_m", "lower_m"), FLOW[:, None], ("flow",))
    return PortedSimulation("cascade", channels, model, ports)


@pytest.mark.parametrize("order", [("upper", "lower"), ("lower", "upper")])
def test_what_runs_over_arrives_in_the_other_tank(order: tuple[str, str]) -> None:
    found = _simulation(_cascade(order)).predicted(VALUES)
    explicit = _simulation(Ode(start=(1.0, 0.5), derivative=_explicit, output=(0, 1)), ()).predicted({})
    lost = _simulation(_cascade(order)).predicted({**VALUES, "overflow_at_upper.into_lower": 0.0})
    assert np.allclose(found, explicit, rtol=1e-9, atol=1e-9)
    assert np.abs(found - lost).max() > 0.05


@pytest.mark.parametrize("order", [("upper", "lower"), ("lower", "upper")])
def test_it_arrives_in_a_model_of_whole_signals(order: tuple[str, str]) -> None:
    def model(inputs: Rows, _values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        level = {"upper": 10.0 * inputs[0], "lower": inputs[0]}
        added = {name: act(name, level[name]) for name in order}
        return level["upper"] + added["upper"], level["lower"] + added["lower"]

    upper, lower = _simulation(Whole(model)).predicted(VALUES).T
    over = STIFFNESS * np.maximum(10.0 * FLOW - RIM, 0.0)
    assert np.allclose(upper, 10.0 * FLOW - over)
    assert np.allclose(lower, FLOW + SHARE * over)


def test_only_tanks_of_one_unit_take_what_runs_over() -> None:
    other = Port("lower", "kg/s", "the lower tank", (Signal("level", "m", "level"),))
    whole = _simulation(_cascade(("upper", "lower")), (PORTS[0], other))
    (effect,) = (each for each in whole.effects if each.name == "overflow_at_upper")
    assert [p.name for p in effect.parameters] == ["limit", "stiffness"]
    assert effect.choices == (("limit", "stiffness"),)
