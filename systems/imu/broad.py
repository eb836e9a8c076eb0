"""BROAD (Laidig, Caruso, Cereatti, Seel, Data 6(7):72, 2021): its trials as recordings of an IMU."""

from pathlib import Path

import numpy as np

from messages.errors import UserError
from systems.imu.recording import ImuRecording

_ARRAYS = ("gyr", "acc", "opt_quat", "opt_pos", "sampling_rate")


def read_trial(path: Path) -> ImuRecording:
    """Return a trial, an npz with gyr, acc, opt_quat, opt_pos and sampling_rate; raises UserError for any other."""
    try:
        with np.load(path) as data:
            missing = [name for name in _ARRAYS if name not in data]
            if missing:
                raise UserError(f"{path}: array {missing[0]} is missing; expected {', '.join(_ARRAYS)}")
            gyr, acc, q, p = (data[name].astype(np.float64) for name in _ARRAYS[:4])
            rate_hz = float(data["sampling_rate"])
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not a trial of BROAD ({error})") from error
    t_s = np.arange(len(gyr)) / rate_hz
    return ImuRecording(t_s, gyr, acc, t_s, q, p)


def import_trial(path: Path, folder: Path) -> None:
    """Write a trial as the plain files of a recording; raises UserError where it cannot."""
    read_trial(path).save(folder)
