"""How foot and shank answer the plate: the turn of the ankle that the plate makes, and of the foot on shoe and heel.

An angle of foot or shank is a mean course over the cycles, a slow curve of each cycle, and an answer to the plate's
turn θ. Only the answer counts as a cause, so what a person does by itself from step to step is no input:

    shank   η = course + slow + Σ hats(s) · θ through second-order lags                                           (1)
    slip    φ − θ = course + slow + Σ hats(s) · (θ, θ̇, θ̈)                                                        (2)

(2) is what a spring and a damper in series with the ankle and the foot's inertia do at frequencies far below their own.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.ankle.mixed_model import Block, MixedFit, Prior, fit
from impedance.ankle.shapes import drift, hats, lagged, spline
from impedance.ankle.smoothing import PLATE_BAND_HZ, smooth_derivatives
from impedance.ankle.trial import AnkleTrial
from messages.arrays import FloatArray, IntArray

MEAN_SPLINES: Final = 16
_SHANK_LAGS_S: Final = (0.05, 0.15, 0.5)
_SHANK_PHASES: Final = 3
_SLIP_PHASES: Final = 5


@dataclass(frozen=True)
class Slip:
    """The foot's turn against the plate about Z and X: `angle` (n, 2) all of it, `answer` (3, n, 2) that to the plate
    with its rate and acceleration."""

    angle: FloatArray
    answer: FloatArray


def slip_of(trial: AnkleTrial, plate: FloatArray, rows: IntArray) -> Slip:
    """Return the slip at `rows` (n,) by (2), from the plate's angle, rate and acceleration (3, N, 2) at all samples.

    Without the foot's markers there is none.
    """
    if trial.foot_rad is None or not len(rows):
        return Slip(np.zeros((len(rows), 2)), np.zeros((3, len(rows), 2)))
    span = (float(trial.stance[rows].min()), float(trial.stance[rows].max()))
    shares = hats(np.clip(trial.stance, *span), span, _SLIP_PHASES)
    angle, answer = np.empty((len(rows), 2)), np.empty((3, len(rows), 2))
    for axis in range(2):
        turn = plate[:, :, axis] - np.array([plate[0, :, axis].mean(), 0.0, 0.0])[:, None]
        columns = np.concatenate([each[:, None] * shares / each.std() for each in turn], axis=1)
        seen = (trial.foot_rad - trial.plate_rad)[rows, axis]
        found = _fitted(trial, rows, seen, span, Block("answer", columns[rows], Prior.FREE))
        angle[:, axis] = seen - found.residual
        of_plate = columns @ found.of("answer")[0]
        for cycle in range(len(trial.perturbation)):
            own = trial.rows_of(cycle)
            here = (rows >= own.start) & (rows < own.stop)
            smooth = smooth_derivatives(of_plate[own, None], trial.settings.rate_hz, PLATE_BAND_HZ)[..., 0]
            answer[:, here, axis] = smooth[:, rows[here] - own.start]
    return Slip(angle, answer)


def own_turns(trial: AnkleTrial, rows: IntArray, plate: FloatArray, shank_rad: FloatArray, slip: Slip) -> FloatArray:
    """Return x and ẋ (2, n, 2) about Z and X at `rows`: plate and slip, minus what the shank answers by (1).

    `plate` (3, n, 2) and the smooth `shank_rad` (n, 2) are those at `rows`.
    """
    turns = plate[:2] + slip.answer[:2]
    turns[0] -= plate[0].mean(axis=0)
    s, cycle = trial.stance[rows], trial.cycle[rows]
    span = (float(s.min()), float(s.max()))
    shares = hats(s, span, _SHANK_PHASES)[:, None, :]
    for axis in range(2):
        causes = plate[:2, :, axis] - np.array([plate[0, :, axis].mean(), 0.0])[:, None]
        answers = np.stack([lagged(each, cycle, trial.settings.rate_hz, _SHANK_LAGS_S) for each in causes])
        columns = (answers[..., None] * shares).reshape(2, len(s), -1)
        found = _fitted(trial, rows, shank_rad[:, axis], span, Block("answer", columns[0], Prior.LEARNT))
        turns[:, :, axis] -= columns @ found.of("answer")[0]
    return turns


def _fitted(
    trial: AnkleTrial, rows: IntArray, angle_rad: FloatArray, span: tuple[float, float], answer: Block
) -> MixedFit:
    line, bend = drift(trial.t_s[rows], trial.cycle[rows])
    blocks = [
        answer,
        Block("course", spline(trial.stance[rows], span, MEAN_SPLINES), Prior.FREE),
        Block("drift_line", line, Prior.LEARNT),
        Block("drift_bend", bend, Prior.LEARNT),
    ]
    return fit(angle_rad, blocks, trial.cycle[rows])
