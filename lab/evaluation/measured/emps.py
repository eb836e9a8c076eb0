"""The drive EMPS (Janot, Gautier and Brunot 2019), a carriage on a screw: a mass with viscous friction and a port."""

from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from discrepancy.ports.acting import PortActs
from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Parameter, Values
from messages.arrays import FloatArray
from systems.own.table import Table

_DIVISOR = 20
"""It is recorded at 1 kHz and moves below 5 Hz: means of 20 samples hold all of it."""
_FIRST = 20
"""Samples that tell where it begins."""
_MOTOR_N_PER_V = 35.15065
_FORCE_HZ, _ORDER, _ENDS_S = 10.0, 4, 0.5
"""Force and motion pass the same filter without delay before they are compared (Gautier 1997), but for the ends."""
_CARRIAGE = Port(
    "carriage", "N", "the carriage", (Signal("position", "m", "position"), Signal("speed", "m/s", "velocity"))
)
_PARAMETERS = (
    Parameter("mass", "kg", neutral=95.0, low=20.0, high=300.0, scale=0.5),
    Parameter("viscous", "N s/m", neutral=200.0, low=0.0, high=2000.0, scale=1.0),
    Parameter("offset", "N", neutral=0.0, low=-50.0, high=50.0, scale=0.1),
)


def emps(path: Path, divisor: int = _DIVISOR) -> PortedSimulation:
    """Return the drive held against one of its files, thinned by `divisor`.

    Raises:
        UserError: The file is absent, or no table with the columns `t`, `vir` (V) and `qm` (m).
    """
    whole = Table.load(path)
    begun = float(whole["qm"][:_FIRST].mean())
    channels = whole.thinned(divisor).channels(["qm"], ["vir"], time="t")
    model = Ode(start=(begun, 0.0), derivative=_derivative, output=(0,), held=False)
    return PortedSimulation("emps", channels, model, (_CARRIAGE,), _PARAMETERS)


def residual_force(path: Path, library: PortedSimulation, values: Values) -> float:
    """Return by how much force and measured motion disagree under complete `values`, RMS in N: inverse dynamics."""
    batch = emps(path, 1).like(library).batch([values])
    rate_hz = 1.0 / batch.step_s
    low_pass = butter(_ORDER, _FORCE_HZ, fs=rate_hz, output="sos")
    position = sosfiltfilt(low_pass, Table.load(path)["qm"])
    speed = np.gradient(position, batch.step_s)
    acts = PortActs(batch, batch.shape)
    told = _derivative((position[None], speed[None]), tuple(batch.inputs), batch.whole_values, acts)[1][0]
    left = sosfiltfilt(low_pass, np.gradient(speed, batch.step_s) - told)
    ends = round(_ENDS_S * rate_hz)
    return float(values["mass"] * np.sqrt(np.mean(left[ends:-ends] ** 2)))


def _derivative(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
    position, speed = state
    (drive,) = inputs
    force = _MOTOR_N_PER_V * drive - values["viscous"] * speed - values["offset"] + act("carriage", position, speed)
    return speed, force / values["mass"]
