"""Two tanks below each other: a pump fills the upper one, each empties by its own weight (Torricelli)."""

import numpy as np

import gaiteyes


def derivative(
    state: gaiteyes.Rows, inputs: gaiteyes.Rows, values: gaiteyes.Arrays, act: gaiteyes.Act
) -> tuple[gaiteyes.FloatArray, ...]:
    """Return the rates of both levels."""
    upper, lower = state
    (pump,) = inputs
    between = values["upper_outlet"] * np.sqrt(np.maximum(upper, 0.0))
    out = values["lower_outlet"] * np.sqrt(np.maximum(lower, 0.0))
    return values["pump"] * pump - between + act("upper", upper), between - out + act("lower", lower)


PORTS = (
    gaiteyes.Port("upper", "m/s", "the upper tank", (gaiteyes.Signal("level", "m", "level"),)),
    gaiteyes.Port("lower", "m/s", "the lower tank", (gaiteyes.Signal("level", "m", "level"),)),
)


def simulation(table: gaiteyes.Table) -> gaiteyes.PortedSimulation:
    """Return the tanks, held against a table of t_s, pump_V and the levels upper_m and lower_m."""
    begun = (table["upper_m"][0], table["lower_m"][0])
    return gaiteyes.PortedSimulation(
        "tanks",
        table.channels(["upper_m", "lower_m"], ["pump_V"]),
        gaiteyes.Ode(start=begun, derivative=derivative, output=(0, 1)),
        PORTS,
        (
            gaiteyes.Parameter("pump", "m/(s V)", neutral=0.002, low=2e-4, high=0.02, scale=1e-5),
            gaiteyes.Parameter("upper_outlet", "m^0.5/s", neutral=0.012, low=1e-3, high=0.1, scale=5e-5),
            gaiteyes.Parameter("lower_outlet", "m^0.5/s", neutral=0.012, low=1e-3, high=0.1, scale=5e-5),
        ),
    )
