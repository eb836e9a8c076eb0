"""What the odometer errs by on rendered walks, to lay it on walks that are told without a picture.

A rendered minute takes a minute or two, a told one seconds. The odometer's errors are alike from step to step, which no
noise drawn for each step is; taken from pictures, they are as they are.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from messages import Calibration, ImuSample, StereoFrame, UserError
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.camera_step import CameraStep
from perception.attitude.track import AttitudeTrack
from perception.motion.watch import MotionWatch
from sim_rig.wearer import SimulatedWearer

_MIRROR = np.array((-1.0, 1.0, -1.0, 1.0, -1.0, 1.0))
"""Of rates, which are axial, and velocities, left and right exchanged: y of B turns."""


@dataclass(frozen=True)
class RenderedErrors:
    """Errors (n, 6) of rate (rad/s) and velocity (m/s) in B of steps 1 … n, and their covariances (n, 6, 6) as stated.

    A longer walk has them again from the first on.
    """

    errors: FloatArray
    covariances: FloatArray

    def each(self, chance: np.random.Generator) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield them as they are, or as seen in a mirror, which `chance` draws."""
        signs = _MIRROR if chance.random() < 0.5 else np.ones(6)
        return itertools.cycle(zip(signs * self.errors, signs[:, None] * self.covariances * signs, strict=True))

    @classmethod
    def rendered(cls, wearer: SimulatedWearer, seconds: float) -> "RenderedErrors":
        """Return what the odometer errs by in the first seconds of a walk, run as in the service."""
        errors, covariances = list[FloatArray](), list[FloatArray]()
        for _, step in odometer_steps(wearer, seconds):
            if step is None:
                continue
            error, _ = step_error(step, wearer, wearer.calibration)
            errors.append(error / step.duration_s)
            covariances.append(step.covariance / step.duration_s**2)
        return cls(np.array(errors), np.array(covariances))

    @classmethod
    def read(cls, path: Path) -> "RenderedErrors":
        """Return what `write` wrote. Raises UserError."""
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return cls(arrays["errors"], arrays["covariances"])
        except (OSError, ValueError, KeyError) as error:
            raise UserError(f"{path}: no errors of an odometer: {error}") from error

    def write(self, path: Path) -> None:
        """Write an NPZ file."""
        np.savez_compressed(path, errors=self.errors, covariances=self.covariances)


def odometer_steps(wearer: SimulatedWearer, seconds: float) -> Iterator[tuple[int, CameraStep | None]]:
    """Yield for each rendered frame its header's t_exposure_ns and the sound step that is told with it, if one is.

    The attitude filter foretells where to look, as in the service.
    """
    watch, track = MotionWatch(wearer.calibration), AttitudeTrack(wearer.calibration)
    for message in wearer.offline_inputs(seconds):
        if isinstance(message, ImuSample):
            watch.add_sample(message)
            track.add_sample(message)
        elif isinstance(message, StereoFrame):
            found = watch.add_frame(message, track.foretold)
            step = found if watch.step_is_sound else None
            if step is not None:
                track.add_camera_step(step)
            watch.finish_frame()
            yield message.header.t_exposure_ns, step


def step_error(step: CameraStep, wearer: SimulatedWearer, calibration: Calibration) -> tuple[FloatArray, FloatArray]:
    """Return turn and travel (6,) less the true ones, and the true mean velocity (3,), in B as it was before."""
    times_ns = np.array([wearer.shutter.true_of(t_ns) for t_ns in (step.t_before_ns, step.t_after_ns)])
    truth = wearer.gait.at(times_ns)
    stated_R, true_R = np.array(calibration.X_BL.R), np.array(wearer.unit.X_BL.R)
    R_WB = truth.R_WB @ true_R @ stated_R.T  # B as the calibration has it: what the mounting errs by is not odometry
    centre_m = truth.p_WB_m + truth.R_WB @ np.array(wearer.unit.X_BL.p_m)
    travel_B = R_WB[0].T @ (centre_m[1] - centre_m[0])
    error = np.concatenate((np.array(step.turn_B) - so3.log(R_WB[0].T @ R_WB[1]), np.array(step.travel_B) - travel_B))
    return error, travel_B / step.duration_s
