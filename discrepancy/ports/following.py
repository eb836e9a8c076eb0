"""States that follow what was measured, where a simulation from the input alone runs away from the recording.

An angle that is integrated from a speed, a mass on no spring, a tank's level: what a missing force has moved stays, so
that soon the simulation is somewhere else than the system was, and what acts there says nothing of it. Predicted from
sample to sample,

    x̂ᵢ₊₁ = Φ(x̂ᵢ + L (yᵢ − h(x̂ᵢ)))                                                                                 (1)

the states stay near the true ones, and all formulas act where the system was. L is the steady gain of Kalman's filter
(1960) for the model linearised about its mean,

    P' = A (P − L C P) Aᵀ + Q,   L = P Cᵀ (C P Cᵀ + R)⁻¹                                                           (2)

where Q holds a white disturbance at each port and R what of the reading its own past does not tell. How much louder the
one is than the other is chosen by the predictions: the noise of a sensor alone is predicted best with no gain at all.
"""

from dataclasses import replace

import numpy as np

from discrepancy.evidence.whitening import whitening
from discrepancy.ports.acting import Batch
from discrepancy.ports.declared import SignalTerm
from discrepancy.ports.marching import slopes
from discrepancy.ports.ode import Ode
from discrepancy.ports.ranges import PortNotes
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.simulation import Values
from messages.arrays import FloatArray

_LOUDER = tuple(10.0 ** (0.5 * k) for k in range(-8, 7))
"""Standard deviations of the disturbance in a sample, in those of the reading's noise, that are tried."""
_MOST_ROUNDS = 3000
"""Of (2): by then it stands still, or the recording is over."""
_STANDS = 1e-6
"""Of the gain, by which it still changes in a round."""
_SOON = 50
"""Samples in which what a disturbance does to the readings is looked for."""
_STEP = 1e-6
"""Of a state's size, for its derivative."""
_BETTER = 0.98
"""Of the error of a simulation: what one from sample to sample must bring it below, or nothing runs away."""


def following(simulation: PortedSimulation, values: Values) -> PortedSimulation | None:
    """Return the simulation with states that follow what was measured, by the gain that predicts best at `values` of
    its own parameters and of its effects; None where none predicts better than the simulation does by itself.

    Outputs that come late or early are not in its library.
    """
    if not isinstance(simulation.model, Ode):
        return None
    terms = [each for each in simulation.library if not (isinstance(each, SignalTerm) and _foresees(each))]
    channels = replace(simulation.channels, shared_noise=True)
    plain = replace(simulation, channels=channels, terms=tuple(terms), gain=None)
    problem = Problem(plain)
    residual = problem.residual(values)
    complete = problem.completed(values)
    innovations = whitening(residual, problem.valid).innovations(residual)
    noise = np.sqrt(np.maximum(np.mean(innovations**2, axis=1), np.finfo(float).tiny))
    gains = _gains(simulation.model, plain.batch([complete]), noise)
    best, least = None, _spread(problem, residual)
    for gain in gains:
        followed = replace(plain, gain=gain)
        told = followed.predicted(complete).T
        if problem.lost(told) > 0.0:
            continue
        left = _spread(problem, problem.difference(told))
        if left < _BETTER * least:
            best, least = followed, left
    return best


def _foresees(term: SignalTerm) -> bool:
    """Return whether a term would take what follows a later measurement for a prediction of an earlier one."""
    return term.side == "output" and term.looks_ahead


def _spread(problem: Problem, residual: FloatArray) -> float:
    """Return the geometric mean of the channels' root mean square residuals."""
    power = (residual**2 * problem.valid).sum(axis=1) / np.maximum(problem.valid.sum(axis=1), 1)
    return float(np.exp(0.5 * np.mean(np.log(np.maximum(power, np.finfo(float).tiny)))))


def _gains(model: Ode, batch: Batch, noise: FloatArray) -> list[FloatArray]:
    """Return the gain (s, c) of (2) for each of the disturbances tried, where there is one.

    A unit of disturbance changes some reading by its noise (standard deviations (c,)), at every port alike.
    """
    states, own = model.integrated(batch)
    if not np.isfinite(states).all():
        return []
    A, C, G = _linearised(model, batch, states, own)
    unit = G / np.maximum((_seen(A, C, G) / noise[:, None]).max(axis=0), np.finfo(float).tiny)
    found = []
    for louder in _LOUDER:
        gain = _steady(A, C, louder**2 * unit @ unit.T, np.diag(noise**2), min(batch.shape[1], _MOST_ROUNDS))
        if gain is not None:
            found.append(gain)
    return found


def _linearised(
    model: Ode, batch: Batch, states: FloatArray, own: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (s, s) and C (c, s) of (2), and what a unit at each port adds to the states in a sample (s, p): means
    over a trajectory (s, 1, n).
    """
    x = np.concatenate((states, own))[:, :, :-1]
    size = np.maximum(np.abs(x).max(axis=2), np.finfo(float).tiny)
    step = model.step(batch, len(states))
    with np.errstate(all="ignore"):
        A = slopes(step, x, step(x, 0), 0, size)[: len(states), : len(states)].mean(axis=(2, 3))
        C = np.stack(
            [_change(model, batch, states, own, row, float(size[row, 0])) for row in range(len(states))], axis=1
        )
    trace = model.traced(batch)
    quiet = trace(PortNotes(batch.ports))
    G = [(trace(PortNotes(batch.ports, port.name, 1.0)) - quiet).mean(axis=1) * batch.step_s for port in batch.ports]
    return A, C, np.stack(G, axis=1)


def _change(model: Ode, batch: Batch, states: FloatArray, own: FloatArray, row: int, size: float) -> FloatArray:
    """Return by how much the outputs (c,) change with one state, its own `size` as the measure of a small step."""
    moved = states.copy()
    moved[row] += _STEP * size
    before, after = (np.array([np.mean(out) for out in model.told(batch, each, own)]) for each in (states, moved))
    return np.asarray((after - before) / (_STEP * size))


def _seen(A: FloatArray, C: FloatArray, G: FloatArray) -> FloatArray:
    """Return the largest change of each output (c, p) that a disturbance in one sample makes soon after."""
    x, most = G, np.abs(C @ G)
    for _ in range(_SOON):
        x = A @ x
        most = np.maximum(most, np.abs(C @ x))
    return np.asarray(most)


def _steady(A: FloatArray, C: FloatArray, Q: FloatArray, R: FloatArray, rounds: int) -> FloatArray | None:
    """Return the gain of (2) once it stands still; None where it is not finite."""
    P, gain = Q, np.zeros((len(A), len(C)))
    for _ in range(rounds):
        before = gain
        with np.errstate(all="ignore"):
            PC = P @ C.T
            S = C @ PC + R
            if not np.isfinite(S).all():
                return None
            gain = np.linalg.solve(S, PC.T).T
            P = A @ (P - gain @ PC.T) @ A.T + Q
            P = 0.5 * (P + P.T)
        if np.abs(gain - before).max() <= _STANDS * np.abs(gain).max():
            break
    return gain if np.isfinite(gain).all() else None
