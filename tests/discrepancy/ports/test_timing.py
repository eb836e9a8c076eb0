"""Delays of signals that jump, and inputs that reach further than what was fitted."""

import numpy as np

from discrepancy import explain
from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Whole
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Channels, Parameter
from messages.arrays import FloatArray

STEP_S = 0.01
GEAR = Port("gear", "N m", "the gear", (Signal("speed", "rad/s", "velocity"),))


def _torque(inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray]:
    claim, speed = inputs
    return (values["gain"] * claim + act("gear", speed),)


def _log(seed: int, size: float, early: int) -> PortedSimulation:
    """Return a claim that jumps, read by a sensor that is samples too early, with coloured noise."""
    rng = np.random.default_rng(seed)
    n = 3000
    steps = np.pad(np.repeat(rng.normal(0.0, size, n // 20), 20), 5, mode="edge")
    levels = np.convolve(steps, np.ones(5) / 5.0, "same")[5:-5] + rng.normal(0.0, 0.1 * size, n)
    speed = np.convolve(rng.normal(0.0, 0.2, n), np.ones(5) / 5.0, "same")
    noise = np.convolve(rng.normal(0.0, 0.1, n + 49), np.ones(50) / 7.0, "valid")
    read = 0.6 * np.roll(levels, -early) + noise
    t_s = STEP_S * np.arange(n, dtype=np.float64)
    channels = Channels(t_s, read[:, None], ("read_Nm",), np.column_stack((levels, speed)), ("claim_Nm", "speed_radps"))
    gain = Parameter("gain", "1", neutral=1.0, low=-3.0, high=3.0, scale=0.001)
    return PortedSimulation("drive", channels, Whole(_torque), (GEAR,), (gain,))


def test_a_claim_that_jumps_is_found_a_sample_late() -> None:
    verdict = explain(_log(1, 5.0, 1), _log(2, 5.0, 1), seed=1).verdict
    (cause,) = verdict.causes
    assert cause.name in ("delay_of_read_Nm", "delay_of_claim_Nm")
    size = cause.parameters["value"]
    assert size.value is not None
    assert abs(size.value + STEP_S) < 0.1 * STEP_S
    assert not verdict.notes


def test_inputs_beyond_what_was_fitted_are_told() -> None:
    verdict = explain(_log(1, 5.0, 1), _log(2, 10.0, 1), seed=1).verdict
    (note,) = verdict.notes
    assert note.startswith("the recording held out: claim_Nm: ")
    assert "beyond what was fitted" in note
