"""The deterministic heart: one input message in, estimates out. No clock, no randomness, no I/O, no threads.

Live, replay and simulation drive this same object; the silence of a device is seen through the ticks.
"""

from collections.abc import Iterator

from daemon.config import parse_configuration
from daemon.health import HealthMonitor
from messages import (
    TOPICS,
    Estimate,
    Frame,
    GroundPlane,
    ImuSample,
    Input,
    Load,
    LoadLevel,
    Reason,
    Reconfigured,
    Tick,
    UnitCalibration,
)
from perception.attitude.track import AttitudeTrack
from perception.frame_guard import FrameGuard
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from perception.motion.watch import MotionWatch

LONGEST_WAIT_NS = 20_000_000
"""How long after its arrival a frame waits for an IMU sample later than its exposure, told by ticks."""

SILENCE_NS = 120_000_000
"""When no frame has arrived for this long, an invalid estimate says so every `FRAME_PERIOD_NS`."""

OTHER_CAMERA_NS = 1_000_000_000
"""When no frame has arrived for this long, the next may be another camera's, with timing of its own."""

FRAME_PERIOD_NS = TOPICS["frame"].period_ns

IMU_SILENCE_NS = 25_000_000
"""When no IMU sample has arrived for this long, attitude and ground are invalid at once, not with the next frame."""

START_NS = 5_000_000_000
"""A camera may take this long to deliver its first frame before its silence is called a fault."""

NO_FRAME_SEQ = -1


class Pipeline:
    """Attitude from each IMU sample, ground from each frame, health once a second."""

    def __init__(self, calibration: UnitCalibration, foothold: FootholdSettings) -> None:
        self._calibration_id = calibration.id
        self._foothold = foothold
        self._attitude = AttitudeTrack(calibration)
        self._ground = GroundEstimator(calibration, foothold)
        self._health = HealthMonitor(calibration.id)
        self._load = Load.NORMAL
        self._frame_guard = FrameGuard()
        self._motion = MotionWatch(calibration)
        self._waiting: Frame | None = None
        self._imu_heard_ns: int | None = None
        self._imu_silent = False
        self._frame_heard_ns = 0
        self._silent_from_ns: int | None = None
        self._camera_due_ns: int | None = None

    def step(self, message: Input) -> Iterator[Estimate]:
        """Take one input, in the order of arrival, and yield the estimates that it completes, each when it is ready.

        To be exhausted before the next step: what need not hold up an estimate is done after it.
        """
        self._health.count_input(message)
        for estimate in self._estimates(message):
            self._health.count_estimate(estimate)
            yield estimate

    def _estimates(self, message: Input) -> Iterator[Estimate]:
        if isinstance(message, ImuSample):
            yield from self._feel(message)
        elif isinstance(message, Frame):
            yield from self._take(message)
        elif isinstance(message, Tick):
            yield from self._notice(message.t_ns)
        elif isinstance(message, LoadLevel):
            self._load = message.load
        elif isinstance(message, Reconfigured):
            self._foothold = parse_configuration(message.configuration, "new configuration").foothold
            self._ground.look_at(self._foothold)

    def _feel(self, sample: ImuSample) -> Iterator[Estimate]:
        if not self._attitude.accepts(sample):
            self._health.count_refused_sample()
            return
        self._imu_heard_ns = max(sample.t_arrival_ns, self._imu_heard_ns or 0)
        self._imu_silent = False
        self._motion.feel(sample)
        attitude = self._attitude.feel(sample)
        doubted = self._motion.reason is Reason.IMU_INCONSISTENT
        yield self._attitude.unfelt(sample.t_sample_ns, Reason.IMU_INCONSISTENT) if doubted else attitude
        if self._waiting is not None and self._is_felt(self._waiting):
            yield from self._see(self._waiting)

    def _take(self, frame: Frame) -> Iterator[Estimate]:
        if self._waiting is not None:
            yield from self._see(self._waiting)
        self._frame_heard_ns = frame.header.t_arrival_ns
        self._silent_from_ns = self._camera_due_ns = self._frame_heard_ns + SILENCE_NS
        doubt = self._frame_guard.judge(frame.header, frame.images)
        if doubt is not Reason.NONE:
            yield self._ground.refused(frame, doubt)
            return
        self._waiting = frame
        if self._is_felt(frame):
            yield from self._see(frame)

    def _notice(self, t_ns: int) -> Iterator[Estimate]:
        if self._waiting is not None and t_ns - self._waiting.header.t_arrival_ns > LONGEST_WAIT_NS:
            yield from self._see(self._waiting)
        yield from self._miss_camera(t_ns)
        yield from self._miss_imu(t_ns)
        yield from self._health.due(t_ns, self._load)

    def _miss_camera(self, t_ns: int) -> Iterator[GroundPlane]:
        if self._silent_from_ns is None or self._camera_due_ns is None:
            self._silent_from_ns, self._camera_due_ns = t_ns + SILENCE_NS, t_ns + START_NS
        if t_ns >= self._silent_from_ns:
            self._silent_from_ns += FRAME_PERIOD_NS * (1 + (t_ns - self._silent_from_ns) // FRAME_PERIOD_NS)
            if t_ns - self._frame_heard_ns > OTHER_CAMERA_NS:
                self._frame_guard.interrupted()
            yield self._without_frame(t_ns, Reason.STARTING if t_ns < self._camera_due_ns else Reason.NO_FRAME)

    def _miss_imu(self, t_ns: int) -> Iterator[Estimate]:
        if self._imu_silent or self._imu_heard_ns is None or t_ns - self._imu_heard_ns <= IMU_SILENCE_NS:
            return
        self._imu_silent = True
        yield self._attitude.unfelt(t_ns)
        yield self._without_frame(t_ns, Reason.NO_IMU)

    def _is_felt(self, frame: Frame) -> bool:
        newest_ns = self._attitude.newest_ns
        return newest_ns is not None and newest_ns > frame.header.t_exposure_ns

    def _see(self, frame: Frame) -> Iterator[GroundPlane]:
        self._waiting = None
        if self._motion.see(frame):
            self._attitude.forget()
        yield self._ground_of(frame)
        if self._motion.judge():
            self._attitude.forget(turns_hold=self._motion.turns_hold)
        if self._motion.reason is Reason.NONE:
            self._attitude.keep()

    def _ground_of(self, frame: Frame) -> GroundPlane:
        if self._motion.reason is not Reason.NONE:
            return self._ground.refused(frame, self._motion.reason)
        attitude = None if self._imu_silent else self._attitude.at(frame.header.t_exposure_ns)
        if attitude is None:
            reason = self._attitude.reason
            return self._ground.refused(frame, Reason.NO_IMU if reason is Reason.NONE else reason)
        return self._ground.estimate(
            frame,
            attitude.R_WB,
            attitude.w_WB_B,
            attitude.rotation_cov_W,
            height_rate_mps=attitude.bob_mps,
            reduced=self._load is Load.REDUCED,
        )

    def _without_frame(self, t_ns: int, reason: Reason) -> GroundPlane:
        return GroundPlane.invalid(
            t_exposure_ns=t_ns,
            frame_seq=NO_FRAME_SEQ,
            reason=reason,
            ahead_m=self._foothold.ahead_m,
            calibration_id=self._calibration_id,
        )
