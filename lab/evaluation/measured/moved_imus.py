"""Real IMUs moved by hand beside motion capture: trials of BROAD and rooms of TUM VI, each in two halves."""

from dataclasses import dataclass

import numpy as np

from lab.evaluation.imu_logs.log import read_logs
from lab.evaluation.imu_logs.truth import sound
from lab.evaluation.measured.broad_recordings import stretch, trial
from lab.evaluation.measured.data_folder import data_folder
from messages.errors import UserError
from systems.imu.recording import ImuRecording

TUNING = ("broad 01", "broad 10", "broad 18", "broad 26", "tumvi room1")
JUDGED = ("broad 07", "broad 15", "broad 24", "broad 32", "tumvi room3", "tumvi room5")
_MOST_S = 30.0
"""Of a half: the finder's cost grows with it, and half a minute is enough to tell."""
_MOVING_RADPS = 0.2
"""Of the turning rate: a trial rests until it is first exceeded."""
_REST_S = 2.0
"""Of a trial's rest, kept before and after its motion."""
_BROAD, _ROOMS = "broad", "tumvi_rooms_imu"


@dataclass(frozen=True)
class Halves:
    """The two halves of a trial's motion, each 30 s at most."""

    name: str
    first: ImuRecording
    second: ImuRecording


def halves(name: str) -> Halves:
    """Return a trial of `TUNING` or `JUDGED`; raises UserError where its data set is absent, or the trial in it."""
    kind, number = name.split()
    if kind == "broad":
        recording = trial(data_folder(_BROAD), number)
        from_s, to_s = _moved(recording)
    else:
        recording = _room(number)
        from_s, to_s = float(recording.t_s[0]), float(recording.t_s[-1])
    half_s = 0.5 * (to_s - from_s)
    seconds = min(half_s, _MOST_S)
    return Halves(name, stretch(recording, from_s, seconds), stretch(recording, from_s + half_s, seconds))


def _moved(recording: ImuRecording) -> tuple[float, float]:
    """Return from when to when a trial moves: its rests before and after are left out but for a moment."""
    moving = np.flatnonzero(np.linalg.norm(recording.w_radps, axis=1) > _MOVING_RADPS)
    return float(recording.t_s[moving[0]]) - _REST_S, float(recording.t_s[moving[-1]]) + _REST_S


def _room(name: str) -> ImuRecording:
    """Return a room of TUM VI: stamps begin at zero, poses that are not to be believed are NaN."""
    for log in read_logs(data_folder(_ROOMS)):
        if log.name == name:
            believed = sound(log)[:, None]
            return ImuRecording(
                t_s=1e-9 * (log.t_ns - log.t_ns[0]),
                w_radps=log.w_B,
                sf_mps2=log.sf_B,
                reference_t_s=1e-9 * (log.truth.t_ns - log.t_ns[0]),
                q_WS=np.where(believed, log.truth.q_WB, np.nan),
                p_W_m=np.where(believed, log.truth.p_WB_m, np.nan),
            )
    raise UserError(f"{data_folder(_ROOMS)}: no {name}_imu.csv.gz")
