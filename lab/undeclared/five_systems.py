"""The five systems of `lab.hidden.five` as somebody models them, each with its ports, and as a user hands them over."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal, Term
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Channels, Parameter
from lab.hidden.five.systems import Recorded
from messages.arrays import FloatArray
from systems.own.table import Table

Rates = Sequence[FloatArray]


def _pendulum(state: Rows, inputs: Rows, values: Arrays, act: Act) -> Rates:
    (angle, rate), (torque,) = state, inputs
    moment = torque - values["damping"] * rate - values["weight"] * np.sin(angle) + act("joint", angle, rate, torque)
    return rate, moment / values["inertia"]


def _motor(state: Rows, inputs: Rows, values: Arrays, act: Act) -> Rates:
    (speed,), (torque,) = state, inputs
    return ((torque - values["damping"] * speed + act("shaft", speed, torque)) / values["inertia"],)


def _car(state: Rows, inputs: Rows, values: Arrays, act: Act) -> Rates:
    (body, rate, wheel, wheel_rate), (road,) = state, inputs
    travel, closing = body - wheel, rate - wheel_rate
    force = values["stiffness"] * travel + values["damping"] * closing + act("suspension", travel, closing)
    tyre = values["tyre"] * (wheel - road) + act("tyre", wheel - road)
    return rate, -force / 300.0, wheel_rate, (force - tyre) / 40.0


def _tanks(state: Rows, inputs: Rows, values: Arrays, act: Act) -> Rates:
    (upper, lower), (pump,) = state, inputs
    upper, lower = np.maximum(upper, 0.0), np.maximum(lower, 0.0)
    passed = values["upper_outlet"] * np.sqrt(upper)
    left = values["lower_outlet"] * np.sqrt(lower)
    return pump - passed + act("upper", upper, pump), passed - left + act("lower", lower, upper)


def _heater(state: Rows, inputs: Rows, values: Arrays, act: Act) -> Rates:
    (temperature,), (power,) = state, inputs
    lost = values["conductance"] * (temperature - 293.0)
    return ((power - lost + act("body", temperature, power)) / values["capacity"],)


_POSITION: Final = "position"
_VELOCITY: Final = "velocity"
_LEVEL: Final = "level"
_INPUT: Final = "input"
_MODELS = {
    "pendulum": (
        Ode(lambda _values: (0.0, 0.0), _pendulum, lambda x, _u, _values, _act: (x[0],)),
        (
            Port("joint", "N·m", "the joint", (
                Signal("angle", "rad", _POSITION), Signal("rate", "rad/s", _VELOCITY), Signal("torque", "N·m", _INPUT),
            )),
        ),
        (
            Parameter("inertia", "kg·m²", 0.048, 0.01, 0.2, 1e-4),
            Parameter("damping", "N·m·s", 0.05, 0.0, 0.5, 1e-4),
            Parameter("weight", "N·m", 1.15, 0.5, 3.0, 1e-3),
        ),
        ("angle_rad",), "torque_nm",
    ),
    "motor": (
        Ode(lambda _values: (0.0,), _motor, lambda x, _u, _values, _act: (x[0],), steps=2),
        (Port("shaft", "N·m", "the shaft", (Signal("speed", "rad/s", _VELOCITY), Signal("torque", "N·m", _INPUT))),),
        (
            Parameter("inertia", "kg·m²", 0.011, 0.001, 0.1, 1e-5),
            Parameter("damping", "N·m·s", 0.03, 0.0, 0.5, 1e-5),
        ),
        ("speed_radps",), "torque_nm",
    ),
    "quarter_car": (
        Ode(lambda _values: (0.0, 0.0, 0.0, 0.0), _car, lambda x, _u, _values, _act: (x[0], x[0] - x[2])),
        (
            Port("suspension", "N", "the suspension", (
                Signal("travel", "m", _POSITION), Signal("closing", "m/s", _VELOCITY),
            )),
            Port("tyre", "N", "the tyre", (Signal("squeeze", "m", _POSITION),)),
        ),
        (
            Parameter("stiffness", "N/m", 15000.0, 1000.0, 1e5, 10.0),
            Parameter("damping", "N·s/m", 1000.0, 0.0, 1e4, 1.0),
            Parameter("tyre", "N/m", 150000.0, 1e4, 1e6, 100.0),
        ),
        ("body_m", "travel_m"), "road_m",
    ),
    "two_tanks": (
        Ode(lambda _values: (1.0, 1.0), _tanks, lambda x, _u, _values, _act: (x[0], x[1])),
        (
            Port("upper", "m/s", "the upper tank", (Signal("level", "m", _LEVEL), Signal("pump", "m/s", _INPUT))),
            Port("lower", "m/s", "the lower tank", (
                Signal("level", "m", _LEVEL), Signal("upper_level", "m", _LEVEL),
            )),
        ),
        (
            Parameter("upper_outlet", "√m/s", 0.045, 0.001, 1.0, 1e-5),
            Parameter("lower_outlet", "√m/s", 0.05, 0.001, 1.0, 1e-5),
        ),
        ("upper_m", "lower_m"), "pump_mps",
    ),
    "heater": (
        Ode(lambda _values: (293.0,), _heater, lambda x, _u, _values, _act: (x[0],)),
        (Port("body", "W", "the body", (Signal("temperature", "K", _LEVEL), Signal("power", "W", _INPUT))),),
        (
            Parameter("capacity", "J/K", 7.5, 0.1, 100.0, 0.01),
            Parameter("conductance", "W/K", 0.06, 0.0, 10.0, 1e-4),
        ),
        ("temperature_k",), "power_w",
    ),
}  # fmt: skip


def simulation(system: str, recorded: Recorded, *, declared: bool, bare: bool = True) -> PortedSimulation:
    """Return the simulation of a recording of a system, its noise `declared` or not, `bare` of any library."""
    *_, names, driven = _MODELS[system]
    noise = recorded.noise if declared else None
    channels = Channels(recorded.t_s, recorded.readings, names, recorded.input[:, None], (driven,), noise)
    return _simulated(system, channels, () if bare else None)


def pendulum(table: Table) -> PortedSimulation:
    """Return the pendulum's simulation."""
    return _of_table("pendulum", table)


def motor(table: Table) -> PortedSimulation:
    """Return the motor's simulation."""
    return _of_table("motor", table)


def quarter_car(table: Table) -> PortedSimulation:
    """Return the quarter car's simulation."""
    return _of_table("quarter_car", table)


def two_tanks(table: Table) -> PortedSimulation:
    """Return the two tanks' simulation."""
    return _of_table("two_tanks", table)


def heater(table: Table) -> PortedSimulation:
    """Return the heater's simulation."""
    return _of_table("heater", table)


def _of_table(system: str, table: Table) -> PortedSimulation:
    """Return the simulation of a table that may declare its readings' noise, each as a column of one value."""
    *_, names, driven = _MODELS[system]
    channels = table.channels(names, (driven,))
    declared = [f"noise_{name}" for name in names]
    if set(declared) <= set(table.columns):
        channels = replace(channels, noise_std=np.array([table[name][0] for name in declared]))
    return _simulated(system, channels, None)


def _simulated(system: str, channels: Channels, terms: tuple[Term, ...] | None) -> PortedSimulation:
    model, ports, parameters, *_ = _MODELS[system]
    return PortedSimulation(system, channels, model, ports, parameters, terms=terms)
