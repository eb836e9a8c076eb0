"""Trials of BROAD as recordings of an IMU, for the finder."""

from dataclasses import replace
from pathlib import Path

from systems.imu.broad import read_trial
from systems.imu.motion import reading_of
from systems.imu.recording import ImuRecording
from systems.imu.simulation import ImuSimulation


def simulation_of(recording: ImuRecording) -> ImuSimulation:
    """Return the simulation that the finder is given of a recording."""
    return ImuSimulation.of(reading_of(recording))


def stretch(recording: ImuRecording, first_s: float, seconds: float) -> ImuRecording:
    """Return a part of a recording; its stamps begin at zero."""
    kept = (recording.t_s >= first_s) & (recording.t_s < first_s + seconds)
    seen = (recording.reference_t_s >= first_s) & (recording.reference_t_s < first_s + seconds)
    return replace(
        recording,
        t_s=recording.t_s[kept] - first_s,
        w_radps=recording.w_radps[kept],
        sf_mps2=recording.sf_mps2[kept],
        reference_t_s=recording.reference_t_s[seen] - first_s,
        q_WS=recording.q_WS[seen],
        p_W_m=recording.p_W_m[seen],
    )


def trial(folder: Path, number: str) -> ImuRecording:
    """Return the trial whose name begins with `number`; raises FileNotFoundError where it is absent."""
    paths = sorted(folder.glob(f"{number}_*.npz"))
    if not paths:
        raise FileNotFoundError(f"{folder}: no trial {number}_*.npz")
    return read_trial(paths[0])
