"""What a finder would add that knew what is hidden in the five systems: its own formula, of its own constants, by an
amount that is fitted.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from discrepancy.ports.declared import Arrays, PortTerm, Rows
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Effect, Parameter
from messages.arrays import FloatArray

ORACLE: Final = "oracle"
_MOST = 10.0
"""Times the true amount."""

Formula = Callable[[Rows, Mapping[str, float]], FloatArray]
"""From the port's signals and the true constants: what acts against the port, for an amount of one."""

_FORMULAS: Final[Mapping[tuple[str, str], tuple[str, Formula]]] = {
    ("pendulum", "magnet"): (
        "joint",
        lambda x, c: x[0] / c["w"] * np.exp(0.5 - 0.5 * (x[0] / c["w"]) ** 2),
    ),
    ("pendulum", "damping_with_angle"): ("joint", lambda x, _c: x[0] ** 2 * x[1]),
    ("geared_motor", "gear_friction"): ("shaft", lambda x, _c: np.abs(x[2]) * np.tanh(x[1] / 0.1)),
    ("geared_motor", "eccentric_gear"): ("shaft", lambda x, _c: x[2] * np.sin(x[0])),
    ("quarter_car", "one_way_damper"): ("suspension", lambda x, _c: -np.abs(x[1])),
    ("quarter_car", "damping_with_travel"): ("suspension", lambda x, _c: -(x[0] ** 2) * x[1]),
    ("two_tanks", "sloping_wall"): ("upper", lambda x, _c: x[0] ** 2),
    ("two_tanks", "siphon"): ("upper", lambda x, _c: x[1] / 0.055 * x[0]),
    ("heater", "radiation"): ("body", lambda x, _c: x[0] ** 4 - 293.0**4),
    ("heater", "convection"): ("body", lambda x, _c: np.maximum(x[0] - 293.0, 0.0) * np.abs(x[0] - 293.0)),
}


def oracle(simulation: PortedSimulation, hidden: str, constants: Mapping[str, float]) -> PortedSimulation:
    """Return the simulation with the true term as its whole library, by the name `ORACLE`."""
    port, formula = _FORMULAS[simulation.system, hidden]
    size = constants["c"]
    amount = Parameter("amount", "1", 0.0, -_MOST * size, _MOST * size, 0.01 * size)

    def acting(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return -p["amount"] * formula(signals, constants), ()

    effect = Effect(ORACLE, (amount,), "It is there.", "Add it.", "None is needed.")
    return replace(simulation, terms=(PortTerm(port, effect, acting),))
