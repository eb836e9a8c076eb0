"""A simulated person who wears one unit: devices for the daemon, frames for a test, and the truth about both."""

import heapq
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from drivers.camera.frame_grid import GRID_NS
from drivers.camera.frame_pool import FramePair
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.sample_wait import POLL_PERIODS
from drivers.imu.settings import Mpu6050Settings
from messages import TOPICS, Calibration, Frame, GroundPlane, GroundTruth, ImuSample, Side, StereoFrame, Tick
from sim_rig.camera.film import Film, make_film, rendering_s
from sim_rig.camera.rendered_frames import FramesAhead, RenderedFrames, Scene
from sim_rig.camera.renderer import Effects
from sim_rig.camera.rig_camera import RigCamera
from sim_rig.camera.shutter import Shutter
from sim_rig.camera.usable_region import RegionSeen, UsableRegion
from sim_rig.imu.data_ready import SimulatedDataReady
from sim_rig.imu.drift import Drifting
from sim_rig.imu.i2c_bus import I2cWires, SimulatedI2cBus
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.imu.simulated_clock import SimulatedClock
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, Unit, draw_unit
from sim_rig.walk.footholds import Footholds
from sim_rig.walk.obstacle_truth import ObstacleTruth
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.terrain_truth import SurfaceTruth, TerrainTruth, TerrainTruthSource
from sim_rig.walk.things import Walker
from sim_rig.walk.truth import FootholdTruth, TruthSource, rectified_axis_L

_IMU_ADDRESS = 0x68
_IMU_POLL_NS = round(POLL_PERIODS * TOPICS["imu"].period_ns)
_POLL_LATENESS_S = 0.15e-3
_TICK_NS = TOPICS["tick"].period_ns
_BOOT_NS = 500_000_000
_SLOTS = 20


class WornCamera(Protocol):
    """A camera that the wearer carries, on whatever walk it was made for."""

    @property
    def shutter(self) -> Shutter:
        """Return when each frame is taken and due."""

    def frames(self, count: int, first: int = 0) -> Iterator[tuple[Frame, GroundTruth]]:
        """Yield frames `first`, `first` + 1 … with their truth."""


class SimulatedWearer:
    """One wearer, who stands until `start_ns` (CLOCK_MONOTONIC) and then walks `scenario`, lap after lap.

    Everything follows from `seed` and `scenario`; `start_ns` only says when. `calibration` is all that the daemon may
    know of the unit: the true values plus one draw of the residual it states, or the true values alone.
    The camera shows the `film` of this walk, or renders as it goes: then its process takes a second or two to start, so
    `start_ns` is best set about 3 s ahead.
    """

    def __init__(
        self,
        seed: int,
        scenario: Scenario,
        start_ns: int,
        perfect_calibration: bool = False,
        *,
        rolling_shutter: bool = True,
        effects: Effects | None = None,
        film: Film | None = None,
    ) -> None:
        self.scenario = scenario
        self.unit: Unit = draw_unit(seed, rolling_shutter=rolling_shutter)
        self.calibration: Calibration = (
            self.unit.exact_calibration()
            if perfect_calibration
            else self.unit.calibration(np.random.default_rng([seed, 6]))
        )
        self._scene = Scene(self.unit, scenario, seed, start_ns)
        self.shutter = Shutter(self.unit.stereo, self.calibration.stereo, seed, start_ns)
        self.gait = self._scene.gait()
        axis_L = rectified_axis_L(self.unit.stereo)
        self.footholds = Footholds(scenario.world, self.gait, seed)
        self._truth = TruthSource(self.unit.X_BL, axis_L, scenario.world, self.gait, self.footholds)
        self._seed = seed
        self._effects = effects
        self._film = film
        self._start_ns = start_ns
        self._region: UsableRegion | None = None
        self._terrain: TerrainTruthSource | None = None
        self._camera: RigCamera | None = None
        self._chip: Mpu6050Chip | None = None
        self._wires: I2cWires | None = None
        self._data_ready: SimulatedDataReady | None = None

    @property
    def wires(self) -> I2cWires:
        """The I2C wires of the IMU, in real time; faults are made here."""
        if self._wires is None:
            self._wires = I2cWires({_IMU_ADDRESS: self._chip_in_real_time()}, elapse=time.sleep)
        return self._wires

    @property
    def data_ready(self) -> SimulatedDataReady:
        """The IMU's data-ready line, in real time; for the thread that reads the bus."""
        if self._data_ready is None:
            self._data_ready = SimulatedDataReady(
                self._chip_in_real_time(), time.monotonic_ns, time.sleep, self._seed, late_share=0.0
            )
        return self._data_ready

    def imu_bus(self) -> SimulatedI2cBus:
        """Return a new handle on the wires, as a driver opens one; the chip is at address 0x68."""
        return self.wires.open()

    def camera(self) -> RigCamera:
        """Return the camera, in real time; its process, if it has no film, starts now."""
        if self._camera is None:
            self._camera = RigCamera(self.frames_ahead(_SLOTS, niceness=5), self.shutter)
        return self._camera

    def frames_ahead(self, slots: int, niceness: int = 0) -> FramesAhead:
        """Return the camera's frames for a player: those of the film, or `slots` ahead from a process of that niceness,
        which starts now.
        """
        if self._film is not None:
            return self._film.frames(self.shutter)
        return RenderedFrames(self._scene, self.shutter, slots=slots, niceness=niceness)

    def film(self, seconds: float, path: Path) -> Film:
        """Render the first `seconds` into the file at `path`; raises what `sim_rig.camera.film.make_film` does."""
        return make_film(self._scene, self.shutter, math.ceil(round(1e9 * seconds / GRID_NS, 6)), path)

    def rendering_s(self) -> float:
        """Return how long a pair of frames takes to render beside other work."""
        return rendering_s(self._scene, self.shutter)

    def truth(
        self, t_exposure_ns: int, ahead_m: float = 0.7, half_length_m: float = 0.3, left_m: float = 0.0
    ) -> GroundTruth:
        """Return the truth of the frame whose header says `t_exposure_ns`, for the foothold `ahead_m` along x of H
        and `left_m` along y.

        `transition` is whether the ground within `half_length_m` before and behind the foothold has an edge.
        """
        return self._truth.at(self.shutter.true_of(t_exposure_ns), t_exposure_ns, ahead_m, half_length_m, left_m)

    def truth_of(self, ground: GroundPlane) -> GroundTruth:
        """Return the truth of the frame that `ground` was measured in, where it was measured."""
        return self.truth(ground.t_exposure_ns, ground.ahead_m, left_m=ground.left_m)

    def region_seen(
        self, t_exposure_ns: int, ahead_m: float = 0.7, half_length_m: float = 0.3, half_width_m: float = 0.3
    ) -> RegionSeen:
        """Return how much of the foothold region the frame whose header says `t_exposure_ns` shows so that it can be
        measured; it is rendered anew for that.
        """
        if self._region is None:
            self._region = UsableRegion(self._scene)
        t_ns = self.shutter.true_of(t_exposure_ns)
        exposure_s = self.shutter.exposure_s(self.shutter.frame_at(t_ns))
        return self._region.seen(t_ns, exposure_s, ahead_m, half_length_m, half_width_m)

    def next_foothold(self, t_exposure_ns: int) -> FootholdTruth | None:
        """Return where the next foot lands after the frame whose header says `t_exposure_ns`, seen from its H.

        None for a wearer who never walks.
        """
        return self._truth.next_foothold(self.shutter.true_of(t_exposure_ns))

    def terrain(self, t_exposure_ns: int, side: Side | None = None) -> TerrainTruth:
        """Return the truth about the ground ahead of the frame whose header says `t_exposure_ns`.

        The foothold is the next one, or the next one of a `side`.
        """
        left = None if side is None else side is Side.LEFT
        return self._terrain_truth().at(self.shutter.true_of(t_exposure_ns), t_exposure_ns, left)

    def obstacles(self, t_exposure_ns: int, half_width_m: float = 0.25) -> list[ObstacleTruth]:
        """Return the things on the path of the frame whose header says `t_exposure_ns`, by distance."""
        return self._terrain_truth().obstacles_at(self.shutter.true_of(t_exposure_ns), half_width_m)

    def surface(self, t_exposure_ns: int, ahead_m: float, left_m: float) -> SurfaceTruth:
        """Return the ground under a point of that frame's H."""
        return self._terrain_truth().surface_at(self.shutter.true_of(t_exposure_ns), ahead_m, left_m)

    def frames(self, count: int, first: int = 0) -> Iterator[tuple[StereoFrame, GroundTruth]]:
        """Yield frames `first`, `first` + 1 … with their truth, as fast as they can be rendered in this process."""
        renderer = self._scene.renderer(self._effects)
        for k in range(first, first + count):
            left, right = np.empty((2, HEIGHT_PX, WIDTH_PX), np.uint8)
            renderer.render(self.shutter.true_ns(k), self.shutter.exposure_s(k), k, left, right)
            frame = FramePair(left, right).frame(self.shutter.header(k))
            yield frame, self.truth(frame.header.t_exposure_ns)

    def offline_inputs(self, seconds: float, camera: "WornCamera | None" = None) -> Iterator[ImuSample | Tick | Frame]:
        """Yield what the pipeline would be given in the first `seconds`, in order of arrival, without waiting.

        `camera` takes the place of the stereo camera.
        The real driver polls the simulated chip on a simulated clock, as often as it does without a data-ready line but
        for a thread's lateness, from a quarter of a second before the start on; ticks come every 10 ms, frames when
        they are due. Nothing is lost.
        """
        clock, imu = self._offline_imu()
        end_ns = self._start_ns + round(seconds * 1e9)
        due_frames = 0
        camera = camera or self
        while camera.shutter.due_ns(due_frames) < end_ns:
            due_frames += 1
        frames = camera.frames(due_frames)
        agenda = heapq.merge(
            ((t_ns, "poll") for t_ns in self._poll_times_ns(clock(), end_ns)),
            ((t_ns, "tick") for t_ns in range(self._start_ns, end_ns, _TICK_NS)),
            ((camera.shutter.due_ns(k), "frame") for k in range(due_frames)),
        )
        for t_ns, event in agenda:
            clock.advance_to(t_ns)
            if event == "poll":
                yield from imu.read(timeout_s=0.0)
            elif event == "tick":
                yield Tick(t_ns=t_ns)
            else:
                frame, _ = next(frames)
                yield frame
        imu.close()

    def offline_samples(self, seconds: float) -> Iterator[ImuSample]:
        """Yield the samples alone of `offline_inputs`, without a picture."""
        clock, imu = self._offline_imu()
        for t_ns in self._poll_times_ns(clock(), self._start_ns + round(seconds * 1e9)):
            clock.advance_to(t_ns)
            yield from imu.read(timeout_s=0.0)
        imu.close()

    def close(self) -> None:
        """End the camera's process, if it was started."""
        if self._camera is not None:
            self._camera.close()

    def _terrain_truth(self) -> TerrainTruthSource:
        if self._terrain is None:
            stereo, walker = self.unit.stereo, Walker(self.gait, self.scenario.world, self._seed)
            axis_L = rectified_axis_L(stereo)
            self._terrain = TerrainTruthSource(
                self.unit.X_BL, axis_L, stereo.left, self.scenario, self.footholds, walker
            )
        return self._terrain

    def _offline_imu(self) -> tuple[SimulatedClock, Mpu6050]:
        """Return the driver, set up on a new chip, and the clock of both, which stands just before the start."""
        clock = SimulatedClock(self._start_ns - _BOOT_NS)
        wires = I2cWires({_IMU_ADDRESS: self._new_chip(clock)}, elapse=clock.sleep)
        imu = Mpu6050(wires.open, settings=Mpu6050Settings(), clock=clock, sleep=clock.sleep)
        imu.open()
        return clock, imu

    def _poll_times_ns(self, from_ns: int, to_ns: int) -> list[int]:
        planned_ns = np.arange(from_ns, to_ns, _IMU_POLL_NS)
        lateness_s = np.random.default_rng([self._seed, 7]).exponential(_POLL_LATENESS_S, len(planned_ns))
        times_ns: list[int] = np.sort(planned_ns + (lateness_s * 1e9).astype(np.int64)).tolist()
        return times_ns

    def _chip_in_real_time(self) -> Mpu6050Chip:
        if self._chip is None:
            self._chip = self._new_chip(time.monotonic_ns)
        return self._chip

    def _new_chip(self, clock: Callable[[], int]) -> Mpu6050Chip:
        drifting = Drifting(self.scenario.drift, self._start_ns)
        return Mpu6050Chip(self.gait.imu, self.unit.chip, clock, self._seed, drifting=drifting)
