"""A hysteresis that hardens, with the constants of a published benchmark (Noël and Schoukens 2016), is found again."""

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Channels, Parameter
from messages.arrays import FloatArray

_RATE_HZ, _N, _FINE = 750.0, 1200, 20
_MASS_KG, _DAMPING, _STIFFNESS = 2.0, 10.0, 5e4
_ALPHA, _BETA, _GAMMA, _DELTA = 5e4, 1e3, 0.8, -1.1
_MOUNT = Port("mount", "N", "the mount", (Signal("place", "m", "position"), Signal("speed", "m/s", "velocity")))


def _rates(x: FloatArray, force: float) -> FloatArray:
    place, speed, z = x
    turned = _BETA * (_GAMMA * abs(speed) * z + _DELTA * speed * abs(z))
    return np.array((speed, (force - _STIFFNESS * place - _DAMPING * speed - z) / _MASS_KG, _ALPHA * speed - turned))


def _measured(seed: int) -> tuple[FloatArray, FloatArray]:
    """Return force and place (n,) of the benchmark's formula, by small steps of Heun's method, with its noise."""
    random = np.random.default_rng(seed)
    f_hz = np.fft.rfftfreq(_N, 1.0 / _RATE_HZ)
    spectrum = np.where((f_hz > 5.0) & (f_hz < 150.0), np.exp(2j * np.pi * random.random(len(f_hz))), 0.0)
    force = np.fft.irfft(spectrum, _N)
    force *= 50.0 / force.std()
    x, h, places = np.zeros(3), 1.0 / _RATE_HZ / _FINE, np.empty(_N)
    for i in range(_N):
        places[i] = x[0]
        for _ in range(_FINE):
            first = _rates(x, force[i])
            x = x + 0.5 * h * (first + _rates(x + h * first, force[i]))
    return force, places + random.normal(0.0, 8e-6, _N)


def _modelled(seed: int) -> PortedSimulation:
    def derivative(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        place, speed = state
        pull = inputs[0] - values["k"] * place - values["c"] * speed + act("mount", place, speed)
        return speed, pull / _MASS_KG

    force, place = _measured(seed)
    channels = Channels(np.arange(_N) / _RATE_HZ, place[:, None], ("place_m",), force[:, None], ("force_N",))
    parameters = (Parameter("k", "N/m", 8e4, 1e3, 1e6, 1e2), Parameter("c", "N s/m", 20.0, 0.0, 500.0, 0.5))
    return PortedSimulation("mount", channels, Ode((0.0, 0.0), derivative, (0,)), (_MOUNT,), parameters)


@pytest.mark.long
def test_a_hysteresis_that_hardens_is_found_with_its_constants() -> None:
    found = explain(_modelled(1), _modelled(2), seed=1, only=("hysteresis_at_mount", "cubic_spring_at_mount"))
    assert found.verdict.causes[0].name == "hysteresis_at_mount"
    told = {name: each.value for name, each in found.verdict.causes[0].parameters.items()}
    within = 0.5 / (_BETA * _GAMMA)
    assert told == pytest.approx(
        {"value": _ALPHA * within, "within": within, "softens": _BETA * _DELTA * within}, rel=0.1
    )
    values = dict(found.values_after)
    assert values["k"] == pytest.approx(_STIFFNESS, rel=0.05)
    left = found.verdict.gain.held_out_nrmse_after
    assert left is not None
    assert left < 0.02
