"""The same simulated person with a depth camera: depth frames, offline inputs and the truth about both."""

from collections.abc import Iterator

import numpy as np

from messages import DepthFrame, DepthUnitCalibration, Frame, GroundPlane, GroundTruth, ImuSample, Tick, UserError
from sim_rig.camera.depth_renderer import DepthErrors, DepthRenderer
from sim_rig.camera.depth_unit import DEPTH_HEIGHT_PX, DEPTH_WIDTH_PX, draw_depth_unit
from sim_rig.camera.shutter import Shutter
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.truth import TruthSource
from sim_rig.wearer import SimulatedWearer


class DepthWearer:
    """The person and IMU of `SimulatedWearer(seed, scenario, start_ns)`, and a depth camera (see `draw_depth_unit`).

    Raises UserError for a scenario with things in the picture or rough ground: only smooth ground has a depth here.
    """

    def __init__(
        self,
        seed: int,
        scenario: Scenario,
        start_ns: int,
        perfect_calibration: bool = False,
        errors: DepthErrors | None = None,
    ) -> None:
        if scenario.things or scenario.world.relief is not None:
            raise UserError(f"scenario '{scenario.name}' is not for a depth camera, which shows smooth ground alone")
        self._person = SimulatedWearer(seed, scenario, start_ns, perfect_calibration)
        self.gait = self._person.gait
        self.unit, stated = draw_depth_unit(seed, perfect_calibration=perfect_calibration)
        self.calibration: DepthUnitCalibration = stated
        self.shutter = Shutter(self.unit.depth, stated.depth, seed, start_ns)
        self._truth = TruthSource(
            self.unit.X_BD, np.array([0.0, 0.0, 1.0]), scenario.world, self.gait, self._person.footholds
        )
        self._renderer = DepthRenderer(self.unit, scenario.world, self.gait, seed, errors)

    def truth(
        self, t_exposure_ns: int, ahead_m: float = 0.7, half_length_m: float = 0.3, left_m: float = 0.0
    ) -> GroundTruth:
        """Return the truth of the frame whose header says `t_exposure_ns` (see `SimulatedWearer.truth`)."""
        return self._truth.at(self.shutter.true_of(t_exposure_ns), t_exposure_ns, ahead_m, half_length_m, left_m)

    def truth_of(self, ground: GroundPlane) -> GroundTruth:
        """Return the truth of the frame that `ground` was measured in, where it was measured."""
        return self.truth(ground.t_exposure_ns, ground.ahead_m, left_m=ground.left_m)

    def frames(self, count: int, first: int = 0) -> Iterator[tuple[DepthFrame, GroundTruth]]:
        """Yield frames `first`, `first` + 1 … with their truth, as fast as they can be rendered."""
        for k in range(first, first + count):
            depth = np.empty((DEPTH_HEIGHT_PX, DEPTH_WIDTH_PX), np.uint16)
            self._renderer.render(self.shutter.true_ns(k), k, depth)
            depth.flags.writeable = False
            frame = DepthFrame(header=self.shutter.header(k), depth=depth)
            yield frame, self.truth(frame.header.t_exposure_ns)

    def offline_inputs(self, seconds: float) -> Iterator[ImuSample | Tick | Frame]:
        """Yield what the pipeline would be given in the first `seconds` (see `SimulatedWearer.offline_inputs`)."""
        return self._person.offline_inputs(seconds, self)
