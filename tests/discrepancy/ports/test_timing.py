"""Delays and lags between samples, delays of signals that jump, inputs that reach further than what was fitted."""

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Whole
from discrepancy.ports.ranges import spans
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Channels, Parameter
from lab.hidden.five.studied import CLEAN, studied
from lab.undeclared.five_systems import simulation
from messages.arrays import FloatArray
from tests.bench.ported import RATE_HZ, sled

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


def _changed(name: str, key: str, value: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the times, what the sled's channel of an effect is without it, and what with it."""
    whole = sled(3)
    before, after = whole.predicted_many([{}, {f"{name}.{key}": value}])
    place = whole.channels.names.index(name.partition("_of_")[2])
    return whole.channels.t_s, before[:, place], after[:, place]


def test_half_a_sample_late_is_late_and_not_smoothed() -> None:
    _, before, after = _changed("delay_of_place_m", "value", 0.5 / RATE_HZ)
    straight = 0.5 * (before[1:] + before[:-1])
    beside = after[1:] - straight
    bent = -np.diff(before, 2) / 8.0  # what a parabola is above its chord in the middle
    assert np.corrcoef(beside[2:-1], bent[2:])[0, 1] > 0.99
    assert np.std(beside[2:-1]) == pytest.approx(np.std(bent[2:]), rel=0.1)


def test_a_lag_of_what_is_read_is_that_of_a_continuous_filter() -> None:
    tau = 0.06
    t_s, before, after = _changed("lag_of_place_m", "value", tau)
    fine_s = np.linspace(0.0, t_s[-1], 64 * (len(before) - 1) + 1)
    path = np.interp(fine_s, t_s, before)
    step = fine_s[1] - fine_s[0]
    slow = np.empty_like(path)
    slow[0] = path[0]
    for k in range(len(path) - 1):
        slow[k + 1] = slow[k] + step / tau * (0.5 * (path[k] + path[k + 1]) - slow[k])
    assert np.abs(after - slow[::64]).max() < 2e-3 * np.ptp(before)


def test_a_held_input_bends_a_speed_at_each_sample_and_a_position_not() -> None:
    def bent(system: str) -> frozenset[str]:
        return spans(simulation(system, studied(system, CLEAN, 1), declared=True)).bent

    assert bent("pendulum") == {"angle_rad"}
    assert bent("motor") == set()
