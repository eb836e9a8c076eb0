"""An IMU against a reference motion, as a system of the discrepancy finder."""

from pathlib import Path

from systems.imu.motion import reading_of
from systems.imu.recording import ImuRecording
from systems.imu.simulation import ImuSimulation


def load(folder: Path) -> ImuSimulation:
    """Return the simulation of the recording in `folder`; raises UserError with one line for a user's mistake."""
    return ImuSimulation.of(reading_of(ImuRecording.load(folder)))
