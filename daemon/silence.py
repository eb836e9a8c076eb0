"""When IMU and camera last delivered, and what a tick tells of their silence. No clock: a tick brings the time."""

from messages import TOPICS, Reason

FRAME_PERIOD_NS = TOPICS["frame"].period_ns

CAMERA_SILENCE_NS = 120_000_000
"""When no frame has arrived for this long, that is said every `FRAME_PERIOD_NS`."""

CAMERA_START_NS = 5_000_000_000
"""A camera may take this long to deliver its first frame before its silence is called a fault."""

IMU_SILENCE_NS = 25_000_000
"""When no IMU sample has arrived for this long, attitude and ground are invalid at once, not with the next frame."""


class Silence:
    """Takes the arrivals of samples and frames. The IMU is silent from the tick that finds it so to the next sample."""

    def __init__(self) -> None:
        self.imu_is_silent = False
        self._imu_arrival_ns: int | None = None
        self._frame_arrival_ns = 0
        self._report_at_ns: int | None = None
        self._camera_due_ns = 0

    def sample_arrived(self, t_ns: int) -> None:
        """Take the arrival of a sample."""
        self._imu_arrival_ns = max(t_ns, self._imu_arrival_ns or 0)
        self.imu_is_silent = False

    def frame_arrived(self, t_ns: int) -> None:
        """Take the arrival of a frame."""
        self._frame_arrival_ns = t_ns
        self._report_at_ns = self._camera_due_ns = t_ns + CAMERA_SILENCE_NS

    def imu_falls_silent(self, t_ns: int) -> bool:
        """Return whether the tick at `t_ns` is the first to find the IMU silent."""
        if self.imu_is_silent or self._imu_arrival_ns is None or t_ns - self._imu_arrival_ns <= IMU_SILENCE_NS:
            return False
        self.imu_is_silent = True
        return True

    def of_camera(self, t_ns: int) -> Reason:
        """Return STARTING or NO_FRAME where the camera is silent and that is due to be said again, else NONE."""
        if self._report_at_ns is None:
            self._report_at_ns, self._camera_due_ns = t_ns + CAMERA_SILENCE_NS, t_ns + CAMERA_START_NS
        if t_ns < self._report_at_ns:
            return Reason.NONE
        self._report_at_ns += FRAME_PERIOD_NS * (1 + (t_ns - self._report_at_ns) // FRAME_PERIOD_NS)
        return Reason.STARTING if t_ns < self._camera_due_ns else Reason.NO_FRAME

    def since_frame_ns(self, t_ns: int) -> int:
        """Return how long ago the newest frame arrived; without one since the clock's beginning."""
        return t_ns - self._frame_arrival_ns
