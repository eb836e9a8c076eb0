"""The service and a virtual prosthesis in one loop, faster than real time: frames on a bus, both ways.

A picture's set-point is published `COMPUTING_NS` after the picture arrived; one frame takes `FRAME_NS` of the bus.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from daemon.pipeline import Pipeline
from daemon.publish_can import CanPublisher
from daemon.stamping import Stamper
from drivers.camera.frame_pool import FramePair
from drivers.can.link import SendResult
from lab.faults.offline import arrival_ns
from lab.prosthesis.controls import InertialSlope, OfGround, ToldByTruth
from lab.prosthesis.judge import JudgedProsthesis
from messages import Frame, GroundTruth, ImuSample, Input, Side, Source, StereoFrame, Tick
from messages.can_frames import CanFrame, CanMessage, can_id, decode_ankle, profile
from messages.e2e import E2eCheck, E2eReceiver
from messages.setpoint import Setpoint
from sim_rig.camera.shutter import Shutter
from sim_rig.prosthesis.bus_faults import Arrived, BusFaults
from sim_rig.prosthesis.node import ProsthesisNode, SetpointControls
from sim_rig.prosthesis.prosthesis import Controls, VirtualProsthesis
from sim_rig.unit import HEIGHT_PX, WIDTH_PX
from sim_rig.wearer import SimulatedWearer

START_NS: Final = 10_000_000_000
COMPUTING_NS: Final = 25_000_000
DRAIN_NS: Final = 1_000_000
"""After which the bus's thread looks again what is due."""
FRAME_NS: Final = 260_000
"""Of 130 bits at 500 kbit/s."""

_DARK_LEVELS = 4


@dataclass(frozen=True)
class Fitted:
    """A wearer of `mass_kg` who is fitted with a prosthesis on `side`, drawn by `seed`."""

    wearer: SimulatedWearer
    seed: int
    mass_kg: float
    side: Side = Side.RIGHT

    @property
    def of_ground(self) -> OfGround:
        """Return what the ankle should be on some ground."""
        return OfGround(self.mass_kg)

    def with_controls(self, controls: Controls) -> JudgedProsthesis:
        """Return the prosthesis with these controls."""
        wearer = self.wearer
        prosthesis = VirtualProsthesis(
            wearer.scenario,
            wearer.gait,
            wearer.footholds,
            controls,
            side=self.side,
            mass_kg=self.mass_kg,
            seed=self.seed,
        )
        return JudgedProsthesis(prosthesis, self.of_ground)

    def told_by_foot(self) -> JudgedProsthesis:
        """Return one that is told the slope by its own foot, a step late."""
        controls = InertialSlope(self.of_ground, self.seed)
        judged = self.with_controls(controls)
        controls.watch(judged.prosthesis)
        return judged

    def told_by_truth(self) -> JudgedProsthesis:
        """Return one that is told the true ground."""
        controls = ToldByTruth(self.of_ground)
        judged = self.with_controls(controls)
        controls.watch(judged.prosthesis)
        return judged


class Loop:
    """The whole pipeline on a unit's walk, and the prosthesis that follows its set-points on a bus with `faults`."""

    def __init__(self, fitted: Fitted, faults: BusFaults, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        controls = SetpointControls(fitted.mass_kg, START_NS)
        self.judged = fitted.with_controls(controls)
        self.node = ProsthesisNode(controls, self.judged.prosthesis, faults, fitted.seed, self.judged.advance_to)
        self._check = E2eReceiver(profile(CanMessage.ANKLE_STATE))
        self._stamper, self._bus = Stamper("loop", "loop", Source.SIMULATED), _Bus(START_NS)
        self._publisher = CanPublisher(self._bus, now_ns=lambda: self._bus.t_ns)
        self._told: list[tuple[int, Setpoint]] = []
        self.ankle_states = self.ankle_refused = 0

    def run(self, inputs: Iterable[ImuSample | Tick | Frame]) -> None:
        """Give the pipeline all `inputs`, in order of arrival, and the ankle's states between them."""
        for message in inputs:
            t_ns = arrival_ns(message)
            self._bring(t_ns)
            for frame in self.node.advance_to(t_ns):
                self._take_ankle(frame, t_ns)
            self._step(message, t_ns)

    def _bring(self, t_ns: int) -> None:
        """Let the set-points that are published by `t_ns` go out, and their frames reach the prosthesis."""
        while self._bus.t_ns < t_ns:
            self._bus.t_ns = min(t_ns, self._bus.t_ns + DRAIN_NS)
            while self._told and self._told[0][0] <= self._bus.t_ns:
                published_ns, setpoint = self._told.pop(0)
                self._publisher.publish(setpoint, self._stamper.stamp(setpoint, published_ns))
            self._publisher.drain(0.0)
        for arrived in self._bus.brought(t_ns):
            self.node.hear(arrived.frame, arrived.t_ns)

    def _take_ankle(self, frame: CanFrame, t_ns: int) -> None:
        if frame.can_id != can_id(CanMessage.ANKLE_STATE):
            return
        if self._check.check(frame.data, t_ns) is not E2eCheck.OK:
            self.ankle_refused += 1
            return
        self.ankle_states += 1
        self._step(decode_ankle(frame.data, t_ns), t_ns)

    def _step(self, message: Input, t_ns: int) -> None:
        for estimate in self._pipeline.step(message):
            if isinstance(estimate, Setpoint):
                self._told.append((t_ns + COMPUTING_NS, estimate))


class _Bus:
    """A bus on which each frame takes `FRAME_NS`, at the time `t_ns` that it is told."""

    def __init__(self, t_ns: int) -> None:
        self.t_ns = self._free_ns = t_ns
        self._on_the_way: list[Arrived] = []

    def send(self, frame: CanFrame) -> SendResult:
        """Take a frame."""
        self._free_ns = max(self._free_ns, self.t_ns) + FRAME_NS
        self._on_the_way.append(Arrived(self._free_ns, frame))
        return SendResult.SENT

    def brought(self, t_ns: int) -> Iterator[Arrived]:
        """Yield what has arrived by `t_ns`."""
        while self._on_the_way and self._on_the_way[0].t_ns <= t_ns:
            yield self._on_the_way.pop(0)

    def close(self) -> None:
        """Nothing is to be released."""


class Covered:
    """A wearer's camera that is covered from `from_ns` on: no light, and the sensor's noise."""

    def __init__(self, wearer: SimulatedWearer, from_ns: int) -> None:
        self._wearer, self._from_ns = wearer, from_ns
        self._chance = np.random.default_rng(0)

    @property
    def shutter(self) -> Shutter:
        """Return when each frame is taken and due."""
        return self._wearer.shutter

    def frames(self, count: int, first: int = 0) -> Iterator[tuple[StereoFrame, GroundTruth]]:
        """Yield frames with their truth."""
        numbers = range(first, first + count)
        seen = sum(self.shutter.true_ns(k) < self._from_ns for k in numbers)
        yield from self._wearer.frames(seen, first)
        for k in numbers[seen:]:
            left, right = self._chance.integers(0, _DARK_LEVELS, (2, HEIGHT_PX, WIDTH_PX), np.uint8)
            frame = FramePair(left, right).frame(self.shutter.header(k))
            yield frame, self._wearer.truth(frame.header.t_exposure_ns)
