"""An IMU at rest and a camera in fog, in real time, that fail when a test says so."""

import time
from collections.abc import Sequence

import numpy as np

from drivers.imu.mpu6050 import Mpu6050Counters
from messages import DropCause, FrameHeader, ImuSample, StereoFrame

SIZE = (720, 1280)


class QuietImu:
    """A device at rest; `failure` is raised by every read while it is set."""

    filter_delay_s = 0.005

    def __init__(self) -> None:
        self.counters = Mpu6050Counters()
        self.failure: Exception | None = None
        self.closed = False
        self._seq = 0
        self._due_ns = time.monotonic_ns()

    def read(self, timeout_s: float) -> Sequence[ImuSample]:
        if self.failure is not None:
            raise self.failure
        time.sleep(min(timeout_s, 0.005))
        samples = []
        while self._due_ns <= time.monotonic_ns():
            self._seq += 1
            samples.append(
                ImuSample(
                    seq=self._seq,
                    t_sample_ns=self._due_ns,
                    t_arrival_ns=time.monotonic_ns(),
                    sf_B_mps2=(-6.9, 0.002 * (self._seq % 2), 6.9),  # no chip is still
                    w_WB_B_radps=(0.0, 0.0, 0.0),
                    temperature_degC=30.0,
                )
            )
            self._due_ns += 10_000_000
        return samples

    def close(self) -> None:
        self.closed = True


class GreyCamera:
    """A camera that sees fog, 20 times a second; `failure` is raised by every read while it is set."""

    def __init__(self) -> None:
        self.dropped: dict[DropCause, int] = {}
        self.failure: Exception | None = None
        self.closed = False
        self._seq = 0
        self._grey = np.full(SIZE, 100, np.uint8)

    def read(self, timeout_s: float) -> StereoFrame | None:
        if self.failure is not None:
            raise self.failure
        time.sleep(min(timeout_s, 0.05))
        self._seq += 1
        now_ns = time.monotonic_ns()
        header = FrameHeader(
            seq=self._seq,
            t_exposure_ns=now_ns - 35_000_000,
            t_arrival_ns=now_ns,
            exposure_s=0.005,
            width_px=SIZE[1],
            height_px=SIZE[0],
        )
        return StereoFrame(header=header, left=self._grey, right=self._grey)

    def close(self) -> None:
        self.closed = True
