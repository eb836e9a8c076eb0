"""The attitude that the unit itself makes of its IMU, for recordings without a reference."""

import numpy as np

from messages import Calibration, ImuSample
from messages.errors import UserError
from perception.attitude.track import AttitudeTrack
from systems.wearable.ground_path import Attitude


def own_attitude(samples: list[ImuSample], calibration: Calibration) -> Attitude:
    """Return the project's filter over all samples, yaw from 0 on; raises UserError where it never knew one."""
    track = AttitudeTrack(calibration)
    attitudes = [track.add_sample(sample) for sample in samples if track.accepts(sample)]
    q_WB = np.array([attitude.q_WB for attitude in attitudes]).reshape(-1, 4)
    if np.isfinite(q_WB).all(axis=1).sum() < 2:
        raise UserError("recording: the IMU's samples give no attitude; expected at least a second of them")
    return Attitude.of(np.array([attitude.t_sample_ns for attitude in attitudes]) * 1e-9, q_WB)
