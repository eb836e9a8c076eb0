"""What a run achieved: rates, losses by cause, latency by stage, processor and memory."""

import resource
import time
from pathlib import Path

import msgspec

from daemon.latency import LatencyLog, Spread
from messages import Attitude, Estimate, FrameHeader, GroundPlane, Health, Motion, Status

_PAGE_BYTES = resource.getpagesize()
SETTLED_S = 5.0
"""Memory growth is counted from here on: before, buffers are still being allocated."""


class RunSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Facts of one run. `cpu_share` is of one core, this process alone; memory is resident."""

    seconds: float
    planes_per_s: float
    valid_share: float
    imu_samples_per_s: float
    imu_lost: int
    beats_skipped: dict[str, int]
    latency: dict[str, Spread]
    cpu_share: float
    memory_settled_mb: float
    memory_end_mb: float
    health: Health | None


class Tally:
    """Observer of a running service; cheap enough to sit in the pipeline's thread."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()
        self._cpu_start_s = _cpu_s()
        self._settled_mb = float("nan")
        self._first_ns = self._last_ns = 0
        self._planes = self._valid = self._started = 0
        self._samples = 0
        self._first_sample_ns = self._last_sample_ns = 0
        self.ground: GroundPlane | None = None
        self.motion: Motion | None = None
        self.health: Health | None = None

    def __call__(self, estimate: Estimate, _header: FrameHeader | None) -> None:
        """Count one estimate."""
        if isinstance(estimate, GroundPlane):
            self.ground = estimate
            self._planes += 1
            self._valid += estimate.status is Status.VALID
            self._started += estimate.status is not Status.INITIALISING
            self._first_ns = self._first_ns or estimate.t_exposure_ns
            self._last_ns = estimate.t_exposure_ns
        elif isinstance(estimate, Attitude):
            self._samples += 1
            self._first_sample_ns = self._first_sample_ns or estimate.t_sample_ns
            self._last_sample_ns = estimate.t_sample_ns
        elif isinstance(estimate, Motion):
            self.motion = estimate
        elif isinstance(estimate, Health):
            self.health = estimate
            if self._settled_mb != self._settled_mb and time.monotonic() - self._start_s > SETTLED_S:
                self._settled_mb = _resident_mb()

    def summary(self, latency: LatencyLog, beats_skipped: dict[str, int]) -> RunSummary:
        """Return the facts of the run so far."""
        seconds = time.monotonic() - self._start_s
        return RunSummary(
            seconds=seconds,
            planes_per_s=_rate(self._planes, self._first_ns, self._last_ns),
            valid_share=self._valid / self._started if self._started else float("nan"),
            imu_samples_per_s=_rate(self._samples, self._first_sample_ns, self._last_sample_ns),
            imu_lost=self.health.imu_lost if self.health is not None else 0,
            beats_skipped=beats_skipped,
            latency=latency.summary(),
            cpu_share=(_cpu_s() - self._cpu_start_s) / seconds,
            memory_settled_mb=self._settled_mb,
            memory_end_mb=_resident_mb(),
            health=self.health,
        )


def _rate(count: int, first_ns: int, last_ns: int) -> float:
    return (count - 1) / ((last_ns - first_ns) * 1e-9) if last_ns > first_ns else float("nan")


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * _PAGE_BYTES / 1e6
