"""Where the time goes of each published plane (sensor, wait, compute, publish), and of each IMU sample to the queue."""

from collections import deque

import msgspec
import numpy as np

from messages.arrays import FloatArray


class FrameTimes(msgspec.Struct, frozen=True, kw_only=True):
    """The instants of one frame on its way, CLOCK_MONOTONIC."""

    t_exposure_ns: int
    t_arrival_ns: int
    t_taken_ns: int
    t_computed_ns: int
    t_published_ns: int


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """Median, 99th percentile and maximum in milliseconds."""

    p50_ms: float
    p99_ms: float
    max_ms: float


STAGES = ("sensor", "wait", "compute", "publish", "arrival_to_publish", "exposure_to_publish")
IMU_STAGE = "imu_ready_to_queue"


class LatencyLog:
    """A ring of the newest `capacity` frames (an hour at 20 Hz), and one of as many samples; older ones leave."""

    def __init__(self, capacity: int = 72_000) -> None:
        self._frames: deque[FrameTimes] = deque(maxlen=capacity)
        self._samples_ns = np.zeros(capacity, dtype=np.int64)
        self._sample_count = 0

    def add(self, times: FrameTimes) -> None:
        """Take the times of one published plane."""
        self._frames.append(times)

    def add_sample(self, ready_to_queue_ns: int) -> None:
        """Take how long one IMU sample took from its data-ready instant into the pipeline's queue; by one thread."""
        self._samples_ns[self._sample_count % len(self._samples_ns)] = ready_to_queue_ns
        self._sample_count += 1

    def summary(self) -> dict[str, Spread]:
        """Return the spread of each stage of `STAGES`, and of IMU_STAGE; NaN without frames, or samples."""
        instants = np.array([msgspec.structs.astuple(times) for times in self._frames], dtype=np.int64).reshape(-1, 5)
        exposed, arrived, taken, computed, published = instants.T
        stages = (
            arrived - exposed,
            taken - arrived,
            computed - taken,
            published - computed,
            published - arrived,
            published - exposed,
        )
        spreads = {name: _spread(stage * 1e-6) for name, stage in zip(STAGES, stages, strict=True)}
        return {**spreads, IMU_STAGE: _spread(1e-6 * self._samples_ns[: self._sample_count].astype(np.float64))}


def _spread(values_ms: FloatArray) -> Spread:
    if len(values_ms) == 0:
        return Spread(p50_ms=np.nan, p99_ms=np.nan, max_ms=np.nan)
    p50, p99 = np.percentile(values_ms, (50, 99))
    return Spread(p50_ms=float(p50), p99_ms=float(p99), max_ms=float(values_ms.max()))
