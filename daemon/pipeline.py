"""The deterministic core: one input message in, estimates out. No clock, no randomness, no I/O, no threads.

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
        self._imu_arrival_ns: int | None = None
        self._newest_sample_ns: int | None = None
        self._imu_silent = False
        self._frame_arrival_ns = 0
        self._report_silence_at_ns: int | None = None
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
            yield from self._on_imu(message)
        elif isinstance(message, Frame):
            yield from self._on_frame(message)
        elif isinstance(message, Tick):
            yield from self._on_tick(message.t_ns)
        elif isinstance(message, LoadLevel):
            self._load = message.load
        elif isinstance(message, Reconfigured):
            self._foothold = parse_configuration(message.configuration, "new configuration").foothold
            self._ground.set_foothold(self._foothold)

    def _on_imu(self, sample: ImuSample) -> Iterator[Estimate]:
        if not self._attitude.accepts(sample):
            self._health.count_refused_sample()
            return
        self._imu_arrival_ns = max(sample.t_arrival_ns, self._imu_arrival_ns or 0)
        self._newest_sample_ns = sample.t_sample_ns
        self._imu_silent = False
        self._motion.add_sample(sample)
        attitude = self._attitude.add_sample(sample)
        inconsistent = self._motion.reason is Reason.IMU_INCONSISTENT
        yield self._attitude.invalid_at(sample.t_sample_ns, Reason.IMU_INCONSISTENT) if inconsistent else attitude
        if self._waiting is not None and self._imu_reaches(self._waiting):
            yield from self._estimate_ground(self._waiting)

    def _on_frame(self, frame: Frame) -> Iterator[Estimate]:
        if self._waiting is not None:
            yield from self._estimate_ground(self._waiting)
        self._frame_arrival_ns = frame.header.t_arrival_ns
        self._report_silence_at_ns = self._camera_due_ns = self._frame_arrival_ns + SILENCE_NS
        refusal = self._frame_guard.check(frame.header, frame.images)
        if refusal is not Reason.NONE:
            yield self._no_ground(frame.header.t_exposure_ns, frame.header.seq, refusal)
            return
        self._waiting = frame
        if self._imu_reaches(frame):
            yield from self._estimate_ground(frame)

    def _on_tick(self, t_ns: int) -> Iterator[Estimate]:
        if self._waiting is not None and t_ns - self._waiting.header.t_arrival_ns > LONGEST_WAIT_NS:
            yield from self._estimate_ground(self._waiting)
        yield from self._report_camera_silence(t_ns)
        yield from self._report_imu_silence(t_ns)
        yield from self._health.due(t_ns, self._load)

    def _report_camera_silence(self, t_ns: int) -> Iterator[GroundPlane]:
        if self._report_silence_at_ns is None or self._camera_due_ns is None:
            self._report_silence_at_ns, self._camera_due_ns = t_ns + SILENCE_NS, t_ns + START_NS
        if t_ns >= self._report_silence_at_ns:
            self._report_silence_at_ns += FRAME_PERIOD_NS * (1 + (t_ns - self._report_silence_at_ns) // FRAME_PERIOD_NS)
            if t_ns - self._frame_arrival_ns > OTHER_CAMERA_NS:
                self._frame_guard.reset_timing()
            reason = Reason.STARTING if t_ns < self._camera_due_ns else Reason.NO_FRAME
            yield self._no_ground(t_ns, NO_FRAME_SEQ, reason)

    def _report_imu_silence(self, t_ns: int) -> Iterator[Estimate]:
        if self._imu_silent or self._imu_arrival_ns is None or t_ns - self._imu_arrival_ns <= IMU_SILENCE_NS:
            return
        self._imu_silent = True
        yield self._attitude.invalid_at(t_ns)
        yield self._no_ground(t_ns, NO_FRAME_SEQ, Reason.NO_IMU)

    def _imu_reaches(self, frame: Frame) -> bool:
        return self._newest_sample_ns is not None and self._newest_sample_ns > frame.header.t_exposure_ns

    def _estimate_ground(self, frame: Frame) -> Iterator[GroundPlane]:
        self._waiting = None
        contradiction, discard = self._motion.add_frame(frame)
        if discard:
            self._attitude.roll_back()
        yield self._ground_of(frame, contradiction)
        contradiction, discard = self._motion.finish_frame()
        if discard:
            self._attitude.roll_back(gyro_agrees=self._motion.gyro_agrees)
        if contradiction is Reason.NONE:
            self._attitude.checkpoint()

    def _ground_of(self, frame: Frame, contradiction: Reason) -> GroundPlane:
        t_ns, seq = frame.header.t_exposure_ns, frame.header.seq
        if contradiction is not Reason.NONE:
            return self._no_ground(t_ns, seq, contradiction)
        attitude = None if self._imu_silent else self._attitude.at(t_ns)
        if attitude is None:
            reason = self._attitude.reason
            return self._no_ground(t_ns, seq, Reason.NO_IMU if reason is Reason.NONE else reason)
        return self._ground.estimate(
            frame,
            attitude.R_WB,
            attitude.w_WB_B,
            attitude.rotation_cov_W,
            height_rate_mps=attitude.vertical_swing_mps,
            reduced=self._load is Load.REDUCED,
        )

    def _no_ground(self, t_ns: int, seq: int, reason: Reason) -> GroundPlane:
        return GroundPlane.invalid(
            t_exposure_ns=t_ns,
            frame_seq=seq,
            reason=reason,
            ahead_m=self._foothold.ahead_m,
            calibration_id=self._calibration_id,
        )
