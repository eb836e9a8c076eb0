"""Two cascaded tanks (Schoukens and Noël 2017), the lower one measured: Torricelli's law twice, and a port each."""

from pathlib import Path
from typing import Literal

import numpy as np

from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Channels, Parameter
from messages.arrays import FloatArray
from systems.own.table import Table

_STEP_S = 4.0
_PORTS = tuple(Port(name, "V/s", f"the {name} tank", (Signal("level", "V", "level"),)) for name in ("upper", "lower"))
_PARAMETERS = (
    *(
        Parameter(name, "1/s", neutral=0.05, low=1e-3, high=0.5, scale=1e-4)
        for name in ("pump", "upper_outlet", "lower_outlet")
    ),
    *(Parameter(name, "V", neutral=5.0, low=0.0, high=15.0, scale=0.05) for name in ("upper_begun", "lower_begun")),
)


def tanks(path: Path, which: Literal["Est", "Val"]) -> PortedSimulation:
    """Return the tanks held against the recording of the benchmark's file at `path` that is fitted, or held out.

    Raises:
        UserError: The file is absent, or no table with the columns `uEst`, `yEst`, `uVal` and `yVal` (V).
    """
    table = Table.load(path)
    pump, level = table[f"u{which}"], table[f"y{which}"]
    t_s = np.arange(len(pump), dtype=np.float64) * _STEP_S
    channels = Channels(t_s, level[:, None], ("level_V",), pump[:, None], ("pump_V",))
    model = Ode(
        start=lambda values: (values["upper_begun"], values["lower_begun"]), derivative=_derivative, output=(1,)
    )
    return PortedSimulation("cascaded_tanks", channels, model, _PORTS, _PARAMETERS)


def _derivative(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
    upper, lower = state
    (pump,) = inputs
    between = values["upper_outlet"] * np.sqrt(np.maximum(upper, 0.0))
    out = values["lower_outlet"] * np.sqrt(np.maximum(lower, 0.0))
    return values["pump"] * pump - between + act("upper", upper), between - out + act("lower", lower)
