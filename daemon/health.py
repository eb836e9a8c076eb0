"""What arrived, what was refused and what was lost, counted from the messages alone and published once a second."""

from collections import Counter
from collections.abc import Iterator

from messages import (
    TOPICS,
    AnkleState,
    DeviceCounters,
    DropCause,
    DroppedFrame,
    Estimate,
    Frame,
    GroundPlane,
    Health,
    ImuSample,
    Input,
    Load,
    Reason,
    Status,
)
from perception.ground.known_height import HeightDifference

PERIOD_NS = TOPICS["health"].period_ns
"""Between two health messages, as the table of topics states it."""


class HealthMonitor:
    """Counters since the start of the pipeline."""

    def __init__(self, calibration_id: str, learnt_id: str) -> None:
        self._calibration_id = calibration_id
        self._learnt_id = learnt_id
        self._imu_samples = self._imu_clipped = self._imu_lost = self._imu_refused = 0
        self._frames = self._frames_valid = self._ankle_states = 0
        self._dropped_since_driver: Counter[DropCause] = Counter()
        self._grounds_refused: Counter[Reason] = Counter()
        self._devices = DeviceCounters(t_ns=0)
        self._due_ns: int | None = None

    def count_input(self, message: Input) -> None:
        """Count one input."""
        if isinstance(message, ImuSample):
            self._imu_samples += 1
            self._imu_clipped += message.clipped
            self._imu_lost += message.lost_before
        elif isinstance(message, Frame):
            self._frames += 1
        elif isinstance(message, DroppedFrame):
            self._dropped_since_driver[message.cause] += 1
        elif isinstance(message, AnkleState):
            self._ankle_states += 1
        elif isinstance(message, DeviceCounters):
            self._devices = message

    def count_refused_sample(self) -> None:
        """Count one IMU sample that was not finite, or not later than the one before it."""
        self._imu_refused += 1

    def count_estimate(self, estimate: Estimate) -> None:
        """Count one ground estimate by its status or reason; others are not counted."""
        if not isinstance(estimate, GroundPlane):
            return
        if estimate.status is Status.VALID:
            self._frames_valid += 1
        else:
            self._grounds_refused[estimate.reason] += 1

    def due(self, t_ns: int, load: Load, height: HeightDifference) -> Iterator[Health]:
        """Yield the health message if a second has passed since the last one."""
        if self._due_ns is None:
            self._due_ns = t_ns + PERIOD_NS
        if t_ns < self._due_ns:
            return
        self._due_ns += PERIOD_NS * (1 + (t_ns - self._due_ns) // PERIOD_NS)
        devices = self._devices
        yield Health(
            t_ns=t_ns,
            imu_samples=self._imu_samples,
            imu_lost=self._imu_lost,
            imu_clipped=self._imu_clipped,
            imu_refused=self._imu_refused,
            imu_bus_errors=devices.imu_bus_errors,
            imu_fifo_overflows=devices.imu_fifo_overflows,
            imu_frames_refused=devices.imu_frames_refused,
            imu_resets=devices.imu_resets,
            imu_edges_missed=devices.imu_edges_missed,
            frames=self._frames,
            frames_valid=self._frames_valid,
            frames_dropped=dict(Counter(devices.frames_dropped) + self._dropped_since_driver),
            refused=dict(self._grounds_refused),
            ankle_states=self._ankle_states,
            inbox_dropped=devices.inbox_dropped,
            recorder_dropped=devices.recorder_dropped,
            recording=devices.recording,
            can_errors=devices.can_errors,
            can_bus=devices.can_bus,
            zenoh_errors=devices.zenoh_errors,
            zenoh=devices.zenoh,
            load=load,
            calibration_id=self._calibration_id,
            learnt_id=self._learnt_id,
            height_off_m=height.off_m,
            height_contradicts=height.contradicts,
        )
