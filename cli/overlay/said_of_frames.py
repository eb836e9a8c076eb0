"""What has been said of the newest frames, collected from estimates in the order in which they come."""

from contextlib import suppress

import numpy as np

from cli.overlay.projection import Projection, Sight
from cli.overlay.shapes import Said
from messages import Attitude, Estimate, GroundPlane, Motion, Status, Terrain, UnitCalibration
from perception.attitude.history import AttitudeAt, AttitudeHistory, OutsideHistoryError
from perception.terrain.surfaces import PathSurfaces


class SaidOfFrames:
    """Keeps the estimates of a few frames and the attitudes of a second. Times count from the first ground."""

    def __init__(self, calibration: UnitCalibration) -> None:
        self._projection = Projection(calibration)
        self._attitudes = AttitudeHistory()
        self._frames: dict[int, _Frame] = {}
        self._first_ns: int | None = None

    def add(self, estimate: Estimate) -> None:
        """Take one estimate."""
        if isinstance(estimate, Attitude):
            self._add_attitude(estimate)
        elif isinstance(estimate, GroundPlane):
            self._frame(estimate.t_exposure_ns).ground = estimate
            self._first_ns = estimate.t_exposure_ns if self._first_ns is None else self._first_ns
        elif isinstance(estimate, Motion):
            self._frame(estimate.t_exposure_ns).motion = estimate
        elif isinstance(estimate, Terrain):
            self._frame(estimate.t_exposure_ns).terrain = estimate

    def add_surfaces(self, t_exposure_ns: int, surfaces: PathSurfaces) -> None:
        """Take what the terrain of a frame was made of."""
        self._frame(t_exposure_ns).surfaces = surfaces

    def is_complete(self, t_exposure_ns: int) -> bool:
        """Return whether the last estimate of a frame, its terrain, has come."""
        return t_exposure_ns in self._frames and self._frames[t_exposure_ns].terrain is not None

    def about(self, t_exposure_ns: int) -> Said | None:
        """Return what has been said of a frame; None where that is not even whether it shows ground."""
        frame = self._frames.get(t_exposure_ns)
        if frame is None or frame.ground is None or self._first_ns is None:
            return None
        return Said(
            t_s=1e-9 * (t_exposure_ns - self._first_ns),
            ground=frame.ground,
            terrain=frame.terrain,
            surfaces=frame.surfaces,
            sight=self._sight(t_exposure_ns, frame.motion),
        )

    def _frame(self, t_exposure_ns: int) -> "_Frame":
        frame = self._frames.setdefault(t_exposure_ns, _Frame())
        while len(self._frames) > _MOST_FRAMES:
            self._frames.pop(next(iter(self._frames)))
        return frame

    def _add_attitude(self, attitude: Attitude) -> None:
        newest_ns = self._attitudes.newest_ns
        if newest_ns is not None and attitude.t_sample_ns <= newest_ns:
            return
        if attitude.status is Status.VALID:
            at = AttitudeAt(attitude.t_sample_ns, attitude.q_WB, attitude.w_WB_B_radps, 0.0, np.zeros((3, 3)))
            self._attitudes.append(at)
        else:
            self._attitudes.clear()

    def _sight(self, t_ns: int, motion: Motion | None) -> Sight | None:
        known = motion is not None and motion.status is Status.VALID
        v_H_mps = np.array(motion.velocity_H_mps) if motion is not None and known else np.zeros(3)
        with suppress(OutsideHistoryError):
            return self._projection.sight(self._attitudes.at(t_ns), v_H_mps)
        return None


class _Frame:
    """What has been said of one frame by now."""

    def __init__(self) -> None:
        self.ground: GroundPlane | None = None
        self.motion: Motion | None = None
        self.terrain: Terrain | None = None
        self.surfaces = PathSurfaces((), 0.0)


_MOST_FRAMES = 8
