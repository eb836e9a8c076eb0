"""Simulations that run away from their recording: the states follow what was measured, and what acts there is named."""

from dataclasses import replace

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.following import following
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.search.refits import Refits
from discrepancy.simulation import Channels, Parameter, Values
from discrepancy.values import Neutral
from messages.arrays import FloatArray

RATE_HZ = 100.0
WHEEL = Port("wheel", "N m", "the wheel", (Signal("angle", "rad", "position"), Signal("speed", "rad/s", "velocity")))
HIDDEN: Values = {
    "cogging_at_wheel.sine": 0.6,
    "cogging_at_wheel.cosine": 0.0,
    "cogging_at_wheel.periods": 6.0 / (2.0 * np.pi),
}


def wheel(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
    angle, speed = state
    (torque,) = inputs
    return speed, torque - values["damping"] * speed + act("wheel", angle, speed)


def turned(seed: int, hidden: Values, n: int = 1500) -> PortedSimulation:
    """Return a wheel without a spring, its speed measured: what once moved its angle stays."""
    random = np.random.default_rng(seed)
    t_s = np.arange(n) / RATE_HZ
    torque = sum(0.8 * np.sin(2.0 * np.pi * f * t_s + random.uniform(0.0, 6.0)) for f in random.uniform(0.1, 1.5, 6))
    channels = Channels(t_s, np.zeros((n, 1)), ("speed_radps",), np.asarray(torque)[:, None], ("torque_Nm",))
    found = PortedSimulation(
        "wheel",
        channels,
        Ode(start=(0.0, 0.0), derivative=wheel, output=(1,)),
        (WHEEL,),
        (Parameter("damping", "N m s/rad", 0.25, 0.0, 5.0, 0.005),),
    )
    clean = found.predicted(Neutral(found).completed({"damping": 0.2, **hidden}))
    return replace(found, channels=replace(channels, values=clean + 0.01 * random.standard_normal(clean.shape)))


def test_states_that_follow_predict_the_next_sample_better() -> None:
    plain = turned(1, HIDDEN)
    values = Neutral(plain).completed({"damping": 0.2})
    followed = following(plain, {"damping": 0.2})
    assert followed is not None
    away, near = (np.std(each.predicted(values) - plain.channels.values) for each in (plain, followed))
    assert near < 0.3 * away


def test_right_values_leave_the_noise_alone_with_states_that_follow() -> None:
    plain = turned(1, HIDDEN)
    followed = following(plain, {"damping": 0.2})
    assert followed is not None
    left = followed.predicted(Neutral(followed).completed({"damping": 0.2, **HIDDEN})) - plain.channels.values
    assert np.std(left) < 0.02


def test_nothing_follows_where_nothing_runs_away() -> None:
    plain = turned(1, {})
    assert following(plain, {"damping": 0.2}) is None


def test_what_a_sensor_adds_is_not_followed() -> None:
    plain = turned(1, HIDDEN)
    followed = following(plain, {"damping": 0.2})
    assert followed is not None
    off = {"damping": 0.2, **HIDDEN, "offset_of_speed_radps.value": 0.3}
    shifted = replace(followed, channels=replace(plain.channels, values=plain.channels.values + 0.3))
    left = shifted.predicted(Neutral(shifted).completed(off)) - shifted.channels.values
    assert np.std(left) < 0.02
    assert abs(np.mean(left)) < 0.005


@pytest.mark.long
@pytest.mark.parametrize("seed", [3])
def test_cogging_is_named_where_the_simulated_angle_runs_away(seed: int) -> None:
    found = explain(turned(seed, HIDDEN), turned(seed + 100, HIDDEN), seed=1)
    (cause,) = found.verdict.causes
    assert cause.name == "cogging_at_wheel"
    for name in ("sine", "periods"):
        value, true = cause.parameters[name].value, HIDDEN[f"cogging_at_wheel.{name}"]
        assert value is not None
        assert abs(value / true - 1.0) < 0.03


def test_a_fit_moves_nothing_that_changes_nothing_where_it_begins() -> None:
    followed = following(turned(3, HIDDEN), {"damping": 0.2})
    assert followed is not None
    problem = Problem(followed)
    refits = Refits(problem, ["cogging_at_wheel"])
    near = min(refits.candidates, key=lambda each: abs(each.start["cogging_at_wheel.periods"] - 6.0 / (2.0 * np.pi)))
    found = refits.joined(refits.base, near)
    assert abs(found.values["cogging_at_wheel.sine"] - 0.6) < 0.02
