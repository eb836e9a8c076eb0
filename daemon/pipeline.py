"""The deterministic core: one input message in, estimates out. No clock, no randomness, no I/O, no threads.

Live, replay and simulation drive this same object; the silence of a device is seen through the ticks.
"""

from collections.abc import Callable, Iterable, Iterator

from daemon.config import parse_configuration
from daemon.health import HealthMonitor
from daemon.silence import Silence
from impedance.modulation.modulator import Modulator
from messages import (
    AnkleState,
    Attitude,
    Estimate,
    Frame,
    FrameHeader,
    GroundPlane,
    ImuSample,
    Input,
    Learnt,
    Load,
    LoadLevel,
    Motion,
    NextFoothold,
    PropagatedGround,
    Reason,
    Reconfigured,
    Status,
    Terrain,
    TerrainKind,
    Tick,
    UnitCalibration,
)
from perception.attitude.camera_step import CameraStep
from perception.attitude.filter import AttitudeSettings
from perception.attitude.history import AttitudeAt
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from perception.attitude.track import AttitudeTrack
from perception.frame_guard import FrameGuard
from perception.gait.gait import Gait, NextSteps
from perception.gait.landing import Landing
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from perception.ground.propagation import GroundPropagation
from perception.motion.odometry import Odometry
from perception.motion.watch import MotionWatch
from perception.sample_guard import SampleGuard
from perception.terrain.estimator import TerrainEstimator
from perception.terrain.path_ahead import NO_PATH, PathAhead
from perception.terrain.path_matching import Beside, PathMatching
from perception.terrain.surfaces import PathSurfaces

LONGEST_WAIT_NS = 20_000_000
"""How long after its arrival a frame waits for an IMU sample later than its exposure, told by ticks."""

OTHER_CAMERA_NS = 1_000_000_000
"""When no frame has arrived for this long, the next may be another camera's, with timing of its own."""

NO_FRAME_SEQ = -1

PICTURES_WRONG = (Reason.VIEW_DEFORMED, Reason.EYES_SWAPPED)
"""What the ground finds wrong with the pictures themselves: no estimate of such a frame is valid, and no step to the
next one is believed."""


class Pipeline:
    """Attitude and the ground carried to each IMU sample; ground, the ankle's set-point, the wearer's motion and
    terrain from each frame; health once a second."""

    def __init__(
        self,
        calibration: UnitCalibration,
        foothold: FootholdSettings,
        learnt: Learnt | None = None,
        attitude: AttitudeSettings | None = None,
        setpoints: Modulator | None = None,
        *,
        tells_terrain: bool = True,
    ) -> None:
        """Begin with what the unit has `learnt` in runs before; raises UserError where that is another unit's.

        Without `setpoints` there are none. Who asks for the sensors' errors alone saves the time for the terrain.
        """
        self._calibration_id = calibration.id
        self._foothold = foothold
        self._attitude = AttitudeTrack(calibration, learnt, attitude)
        self._ground = GroundEstimator(calibration, foothold)
        self._health = HealthMonitor(calibration.id, "" if learnt is None else learnt.id)
        self._load = Load.NORMAL
        self._passes_over = False  # terrain of every second frame under load; motion too, where frames come fast enough
        self._sample_guard = SampleGuard()
        self._frame_guard = FrameGuard()
        self._motion = MotionWatch(calibration)
        self._odometry = Odometry(calibration, self._ground.R_BC)
        self._terrain = TerrainEstimator(
            calibration, self._ground.camera, self._ground.R_BC, foothold.nominal_height_m, foothold.side
        )
        self._propagation = GroundPropagation(calibration, self._ground.R_BC)
        self._gait = Gait(calibration, self._ground.R_BC, foothold.side)
        self._setpoints = setpoints
        self._tells_terrain = tells_terrain
        self._kind = TerrainKind.UNKNOWN
        self._come_meanwhile: Callable[[], Iterable[ImuSample | Tick]] = tuple
        self._pictures_are_wrong = False  # as far as the ground of the frame before knows
        self._pictures_are_late = False  # as far as the motion of the frame before knows
        self._waiting: Frame | None = None
        self._newest_sample_ns: int | None = None
        self._silence = Silence()

    @property
    def learnt(self) -> Learnt:
        """Return what the unit has learnt of its sensors by now; it is another object whenever that has changed."""
        return self._attitude.learnt

    @property
    def sensor_errors(self) -> SensorErrors | None:
        """Return what the attitude filter takes the sensors' errors for now; None where it is not valid."""
        return self._attitude.sensor_errors if self._contradiction is Reason.NONE else None

    @property
    def mounting_errors(self) -> MountingErrors | None:
        """Return what it has found of the camera's place in B, clock and distances; None where it is not valid."""
        return self._attitude.mounting_errors if self._contradiction is Reason.NONE else None

    @property
    def surfaces(self) -> PathSurfaces:
        """Return the surfaces of the path that the newest terrain with numbers was made of."""
        return self._terrain.surfaces

    def match_path_beside(self, beside: Beside) -> None:
        """Let another thread, always the same, match the path while the rest is done; the estimates are the same."""
        self._terrain.beside = beside

    def let_first(self, come_meanwhile: Callable[[], Iterable[ImuSample | Tick]]) -> None:
        """Before the terrain of a frame whose ground has been told, take what `come_meanwhile` returns: the samples and
        ticks that arrived next after the frame. The estimates of each topic are the same, some are known sooner."""
        self._come_meanwhile = come_meanwhile

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
        elif isinstance(message, AnkleState):
            self._gait.add_ankle(message)
            if self._setpoints is not None:
                self._setpoints.add_ankle(message)
        elif isinstance(message, LoadLevel):
            self._load = message.load
        elif isinstance(message, Reconfigured):
            self._foothold = parse_configuration(message.configuration, "new configuration").foothold
            self._ground.set_foothold(self._foothold)
            self._gait.side = self._terrain.side = self._foothold.side

    def _on_imu(self, sample: ImuSample) -> Iterator[Estimate]:
        if not (self._sample_guard.check(sample) and self._attitude.accepts(sample)):
            self._health.count_refused_sample()
            return
        self._silence.sample_arrived(sample.t_arrival_ns)
        self._newest_sample_ns = sample.t_sample_ns
        self._motion.add_sample(sample)
        attitude = self._attitude.add_sample(sample)
        if self._attitude.contradiction is Reason.IMU_INCONSISTENT and not self._pictures_are_late:
            attitude = self._attitude.invalid_at(sample.t_sample_ns, Reason.IMU_INCONSISTENT)
        yield attitude
        yield self._propagated(attitude)
        if self._waiting is not None and self._imu_reaches(self._waiting):
            yield from self._estimate_ground(self._waiting)

    def _on_frame(self, frame: Frame) -> Iterator[Estimate]:
        if self._waiting is not None:
            yield from self._estimate_ground(self._waiting)
        self._silence.frame_arrived(frame.header.t_arrival_ns)
        refusal = self._frame_guard.check(frame.header, frame.images)
        if refusal is not Reason.NONE:
            yield from self._nothing(frame.header.t_exposure_ns, frame.header.seq, refusal)
            return
        self._waiting = frame
        if self._imu_reaches(frame):
            yield from self._estimate_ground(frame)

    def _on_tick(self, t_ns: int) -> Iterator[Estimate]:
        if self._waiting is not None and t_ns - self._waiting.header.t_arrival_ns > LONGEST_WAIT_NS:
            yield from self._estimate_ground(self._waiting)
        yield from self._report_silence(t_ns)
        yield from self._health.due(t_ns, self._load, self._ground.height_difference)

    def _report_silence(self, t_ns: int) -> Iterator[Estimate]:
        no_frame = self._silence.of_camera(t_ns)
        if no_frame is not Reason.NONE:
            if self._silence.since_frame_ns(t_ns) > OTHER_CAMERA_NS:
                self._frame_guard.reset_timing()
            yield from self._nothing(t_ns, NO_FRAME_SEQ, no_frame)
        if self._silence.imu_falls_silent(t_ns):
            yield self._attitude.invalid_at(t_ns)
            yield self._propagation.no_ground(t_ns, Reason.NO_IMU)
            yield from self._nothing(t_ns, NO_FRAME_SEQ, Reason.NO_IMU)

    def _imu_reaches(self, frame: Frame) -> bool:
        return self._newest_sample_ns is not None and self._newest_sample_ns > frame.header.t_exposure_ns

    def _estimate_ground(self, frame: Frame) -> Iterator[Estimate]:
        self._waiting = None
        self._passes_over = self._load is Load.REDUCED and not self._passes_over
        tells_terrain = self._tells_terrain and not self._passes_over
        by_imu = self._attitude.at(frame.header.t_exposure_ns) if tells_terrain else None
        matching = None if by_imu is None else self._terrain.begin_matching(frame, by_imu.R_WB)
        follows = not (self._passes_over and self._motion.can_miss(frame.header.t_exposure_ns))
        step = self._motion.add_frame(frame, self._attitude.foretold) if follows else None
        if self._motion.scale_is_doubtful:
            self._attitude.doubt_distances()
        if step is not None:
            self._add_camera_step(step)
        placed = self._placed(frame.header)
        tells_velocity = self._motion.step_is_sound and not self._attitude.knows_velocity
        if step is not None and tells_velocity and not isinstance(placed, Reason):
            placed = step.with_velocity(placed)
        path, steps = NO_PATH, NextSteps()
        if not isinstance(placed, Reason):
            path = self._terrain.path_ahead(placed.t_ns, placed.R_WB, placed.w_WB_B, placed.v_W_mps)
            steps = self._gait.add_frame(placed, self._attitude.at, path)
        ground = self._ground_of(frame, placed, steps.prosthetic, path, follows=follows)
        self._pictures_are_wrong = ground.reason in PICTURES_WRONG
        yield ground
        if self._setpoints is not None:  # before the terrain, which takes longer: the kind is of the frame before
            foothold = self._gait.foothold(steps, ground, path, self._kind)
            yield self._setpoints.setpoint(ground, foothold, self._kind)
        self._propagate(ground, placed)
        yield self._motion_of(frame.header, placed)
        if follows:
            self._motion.judge_clock()
        self._judge_lateness()
        if self._contradiction is Reason.NONE and self._attitude.is_confirmed:
            self._attitude.checkpoint()
        if tells_terrain:
            placed = self._placed_on_path(placed, ground)
            distance_scale = self._attitude.distance_scale
            yield from self._estimates_meanwhile()
            terrain = self._terrain_of(frame, placed, ground, distance_scale, matching)
            self._kind = terrain.kind
            yield self._gait.with_foothold(terrain, steps, ground, path)
        yield from self._estimates_meanwhile()
        if follows:
            self._motion.finish_frame()

    def _judge_lateness(self) -> None:
        """Where it turns out that pictures have been late, discard what their steps have made of the attitude while
        they contradicted it."""
        late = self._motion.reason is Reason.TIME_INCONSISTENT
        if late and not self._pictures_are_late and self._attitude.contradiction is Reason.IMU_INCONSISTENT:
            self._attitude.roll_back(gyro_agrees=True)
        self._pictures_are_late = late

    def _estimates_meanwhile(self) -> Iterator[Estimate]:
        """Take what has come meanwhile. Nothing that follows in a frame depends on it: a recording, in which it stands
        after the frame, gives the same."""
        for message in self._come_meanwhile():
            self._health.count_input(message)
            yield from self._estimates(message)

    def _add_camera_step(self, step: CameraStep) -> None:
        if self._motion.step_is_sound and not self._pictures_are_wrong:
            self._attitude.add_camera_step(step, sound=self._motion.reason is Reason.NONE)
        else:
            self._attitude.check_turn(step)

    @property
    def _contradiction(self) -> Reason:
        """Return why camera and IMU may not be used together, or NONE."""
        return self._attitude.contradiction if self._motion.reason is Reason.NONE else self._motion.reason

    def _placed(self, header: FrameHeader) -> AttitudeAt | Reason:
        """Return the attitude of a frame, or why there is none that may be used."""
        contradiction = self._contradiction
        if contradiction is not Reason.NONE:
            return contradiction
        attitude = None if self._silence.imu_is_silent else self._attitude.at(header.t_exposure_ns)
        if attitude is None:
            reason = self._attitude.reason
            return Reason.NO_IMU if reason is Reason.NONE else reason
        return attitude

    def _ground_of(
        self, frame: Frame, placed: AttitudeAt | Reason, landing: Landing | None, path: PathAhead, *, follows: bool
    ) -> GroundPlane:
        if isinstance(placed, Reason):
            return self._no_ground(frame.header.t_exposure_ns, frame.header.seq, placed)
        ground = self._ground.estimate(
            frame,
            placed.R_WB,
            placed.w_WB_B,
            placed.rotation_cov_W,
            height_rate_mps=placed.vertical_swing_mps,
            v_W_mps=placed.v_W_mps,
            distance_scale=self._attitude.distance_scale,
            focal_difference=self._motion.focal_difference,
            may_begin=self._attitude.is_watched_to(placed.t_ns) if follows else self._attitude.is_watched,
            reduced=self._load is Load.REDUCED,
            place_m=None if landing is None else (landing.ahead_m, landing.left_m),
            path=path,
        )
        if ground.status is Status.VALID and not self._attitude.is_confirmed:
            return self._no_ground(frame.header.t_exposure_ns, frame.header.seq, Reason.UNCONFIRMED)
        return ground

    def _propagate(self, ground: GroundPlane, placed: AttitudeAt | Reason) -> None:
        """Carry `ground` to the samples from now on."""
        if ground.status is not Status.VALID or isinstance(placed, Reason):
            self._propagation.drop(ground.reason)
        else:
            self._propagation.begin(ground, self._attitude.path_from(placed), *self._attitude.motion_covariance)

    def _propagated(self, attitude: Attitude) -> PropagatedGround:
        if attitude.status is not Status.VALID:
            return self._propagation.no_ground(attitude.t_sample_ns, attitude.reason)
        return self._propagation.at(self._attitude.newest)

    def _motion_of(self, header: FrameHeader, placed: AttitudeAt | Reason) -> Motion:
        if isinstance(placed, Reason):
            return self._odometry.no_motion(header.t_exposure_ns, header.seq, placed)
        movement = self._attitude.movement_at(placed)
        if movement is None:
            return self._odometry.no_motion(header.t_exposure_ns, header.seq, Reason.LOW_TEXTURE)
        return self._odometry.motion(header.t_exposure_ns, header.seq, movement)

    def _placed_on_path(self, placed: AttitudeAt | Reason, ground: GroundPlane) -> AttitudeAt | Reason:
        """Return the attitude for the terrain, which has none where the `ground` has none for wrong pictures."""
        if not isinstance(placed, Reason) and ground.reason in PICTURES_WRONG:
            return ground.reason
        if not isinstance(placed, Reason) and not self._attitude.is_confirmed:
            return Reason.UNCONFIRMED
        return self._ambiguous_path() if self._ground.is_ambiguous(ground.t_exposure_ns) else placed

    def _terrain_of(
        self,
        frame: Frame,
        placed: AttitudeAt | Reason,
        ground: GroundPlane,
        distance_scale: float,
        matching: PathMatching | None,
    ) -> Terrain:
        if isinstance(placed, Reason):
            return self._terrain.no_terrain(frame.header.t_exposure_ns, frame.header.seq, placed)
        terrain = self._terrain.estimate(
            frame,
            placed.R_WB,
            placed.w_WB_B,
            placed.v_W_mps,
            height_rate_mps=placed.vertical_swing_mps,
            distance_scale=distance_scale,
            ground=ground,
            matching=matching,
        )
        if self._ground.makes_ambiguous(frame, placed.R_WB, ground, self._terrain.surfaces):
            return self._terrain.no_terrain(frame.header.t_exposure_ns, frame.header.seq, self._ambiguous_path())
        return terrain

    def _ambiguous_path(self) -> Reason:
        """Forget the path, whose points may lie a tile off; return why there is none."""
        self._terrain.begin_anew()
        return Reason.LOW_TEXTURE

    def _nothing(self, t_ns: int, seq: int, reason: Reason) -> Iterator[Estimate]:
        self._propagation.drop(reason)
        ground = self._no_ground(t_ns, seq, reason)
        yield ground
        if self._setpoints is not None:
            yield self._setpoints.setpoint(ground, NextFoothold.unknown(self._gait.side), TerrainKind.UNKNOWN)
        yield self._odometry.no_motion(t_ns, seq, reason)
        yield self._terrain.no_terrain(t_ns, seq, reason)

    def _no_ground(self, t_ns: int, seq: int, reason: Reason) -> GroundPlane:
        return GroundPlane.invalid(
            t_exposure_ns=t_ns,
            frame_seq=seq,
            reason=reason,
            ahead_m=self._foothold.ahead_m,
            calibration_id=self._calibration_id,
        )
