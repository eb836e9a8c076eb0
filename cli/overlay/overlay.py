"""A replay's frames with what was said of them drawn in, in the order in which they were seen."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from cli.overlay.drawing import Said, drawn
from cli.overlay.picture_files import PictureFiles
from cli.overlay.projection import Projection, Sight
from daemon.config import parse_configuration
from messages import (
    Attitude,
    DepthFrame,
    Estimate,
    Frame,
    GroundPlane,
    Input,
    Motion,
    Reconfigured,
    Status,
    StereoFrame,
    Terrain,
    UnitCalibration,
)
from perception.attitude.history import AttitudeAt, AttitudeHistory, OutsideHistoryError
from perception.ground.foothold import FootholdSettings
from perception.terrain.surfaces import PathSurfaces


class Overlay:
    """Takes a pipeline's inputs and estimates as they come, and writes one picture for each frame with a ground.

    `surfaces` returns what the pipeline's newest terrain was made of.
    """

    def __init__(
        self,
        calibration: UnitCalibration,
        foothold: FootholdSettings,
        files: PictureFiles,
        surfaces: Callable[[], PathSurfaces],
    ) -> None:
        self._projection = Projection(calibration)
        self._foothold = foothold
        self._files = files
        self._surfaces = surfaces
        self._attitudes = AttitudeHistory()
        self._frames: dict[int, Frame] = {}
        self._first_ns: int | None = None
        self._said: _SoFar | None = None

    def add_input(self, message: Input) -> None:
        """Take one input, before the pipeline does."""
        if isinstance(message, StereoFrame | DepthFrame):
            self._frames[message.header.t_exposure_ns] = message
            while len(self._frames) > _MOST_FRAMES:
                self._frames.pop(next(iter(self._frames)))
        elif isinstance(message, Reconfigured):
            self._foothold = parse_configuration(message.configuration, "new configuration").foothold

    def add_estimate(self, estimate: Estimate) -> None:
        """Take one estimate; the picture is written once all is said of its frame."""
        if isinstance(estimate, Attitude):
            self._add_attitude(estimate)
        elif isinstance(estimate, GroundPlane):
            self._finish()
            frame = self._frames.pop(estimate.t_exposure_ns, None)
            self._said = None if frame is None else _SoFar(frame, estimate)
        elif self._said is not None and isinstance(estimate, Motion | Terrain):
            if isinstance(estimate, Motion):
                self._said.motion = estimate
            else:
                self._said.terrain, self._said.surfaces = estimate, self._surfaces()

    def close(self) -> None:
        """Write the last picture."""
        self._finish()

    def _add_attitude(self, attitude: Attitude) -> None:
        newest_ns = self._attitudes.newest_ns
        if newest_ns is not None and attitude.t_sample_ns <= newest_ns:
            return
        if attitude.status is Status.VALID:
            at = AttitudeAt(attitude.t_sample_ns, attitude.q_WB, attitude.w_WB_B_radps, 0.0, np.zeros((3, 3)))
            self._attitudes.append(at)
        else:
            self._attitudes.clear()

    def _finish(self) -> None:
        said, self._said = self._said, None
        if said is None:
            return
        t_ns = said.ground.t_exposure_ns
        self._first_ns = t_ns if self._first_ns is None else self._first_ns
        whole = Said(
            t_s=1e-9 * (t_ns - self._first_ns),
            ground=said.ground,
            terrain=said.terrain,
            surfaces=said.surfaces,
            sight=self._sight(t_ns, said.motion),
        )
        self._files.write(drawn(said.frame.images[0], whole, self._foothold))

    def _sight(self, t_ns: int, motion: Motion | None) -> Sight | None:
        known = motion is not None and motion.status is Status.VALID
        v_H_mps = np.array(motion.velocity_H_mps) if motion is not None and known else np.zeros(3)
        with suppress(OutsideHistoryError):
            return self._projection.sight(self._attitudes.at(t_ns), v_H_mps)
        return None


class _SoFar:
    """What has been said of one frame by now."""

    def __init__(self, frame: Frame, ground: GroundPlane) -> None:
        self.frame, self.ground = frame, ground
        self.motion: Motion | None = None
        self.terrain: Terrain | None = None
        self.surfaces = PathSurfaces((), 0.0)


_MOST_FRAMES = 4
