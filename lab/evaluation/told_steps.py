"""What the odometer would tell of a simulated walk, without a picture: true steps with noise of its size."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from calib.pair import CORNERS_Z_M
from messages import Attitude, Calibration, ImuSample, Reason, vec3
from messages.arrays import FloatArray
from perception.attitude.camera_step import CameraStep
from perception.attitude.track import AttitudeTrack
from sim_rig.unit import Unit
from sim_rig.wearer import SimulatedWearer

_TOLD_FRAMES_LATER = 1
"""The odometer tells a step with the frame after it."""


class StepErrors(Protocol):
    """What an odometer errs by, step by step."""

    def each(self, chance: np.random.Generator) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the error (6,) of each step, of rate (rad/s) first, then of velocity (m/s), in B; and its covariance as
        stated."""


@dataclass(frozen=True)
class OdometerNoise:
    """Errors of each step apart from all others: one standard deviation per axis, of velocity and of rate."""

    v_mps: float
    w_radps: float

    def each(self, chance: np.random.Generator) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield errors that `chance` draws, for ever."""
        sigma = np.repeat((self.w_radps, self.v_mps), 3)
        while True:
            yield sigma * chance.standard_normal(6), np.diag(sigma**2)


@dataclass(frozen=True)
class ToldStep:
    """A step, and when it is told: at the arrival of the frame after it."""

    t_told_ns: int
    step: CameraStep


def told_steps(wearer: SimulatedWearer, seconds: float, noise: StepErrors, seed: int) -> Iterator[ToldStep]:
    """Yield the steps between the wearer's frames in the first `seconds`.

    Turn and travel are those of the true left camera; where it sits in B, the stamps and the scale of its distances are
    the calibration's, with its residual. `seed` draws the noise.
    """
    errors = noise.each(np.random.default_rng([seed, 14]))
    shutter, calibration = wearer.shutter, wearer.calibration
    frames = range(round(20.0 * seconds))
    motion = wearer.gait.at(np.array([shutter.true_ns(k) for k in frames]))
    R_WL = motion.R_WB @ np.array(wearer.unit.X_BL.R)
    p_WL_m = motion.p_WB_m + motion.R_WB @ np.array(wearer.unit.X_BL.p_m)
    R_BL = np.array(calibration.X_BL.R)
    scale = 1.0 + depth_error(wearer.unit, calibration)
    for k in frames[1:-_TOLD_FRAMES_LATER]:
        t_before_ns, t_after_ns = (shutter.header(j).t_exposure_ns for j in (k - 1, k))
        duration_s = 1e-9 * (t_after_ns - t_before_ns)
        turn_L = Rotation.from_matrix(R_WL[k - 1].T @ R_WL[k]).as_rotvec()
        travel_L = scale * R_WL[k - 1].T @ (p_WL_m[k] - p_WL_m[k - 1])
        error, covariance = next(errors)
        off = duration_s * error
        yield ToldStep(
            shutter.due_ns(k + _TOLD_FRAMES_LATER),
            CameraStep(
                t_before_ns,
                t_after_ns,
                vec3(R_BL @ turn_L + off[:3]),
                vec3(R_BL @ travel_L + off[3:]),
                duration_s**2 * covariance,
                calibration.X_BL.p_m,
            ),
        )


def attitudes(track: AttitudeTrack, samples: Iterable[ImuSample], steps: Iterator[ToldStep]) -> Iterator[Attitude]:
    """Yield what the service would say after each sample: invalid while the IMU contradicts the camera.

    Steps are added behind the sample whose arrival they do not come after.
    """
    following = next(steps, None)
    for sample in samples:
        attitude = track.add_sample(sample)
        yield track.invalid_at(sample.t_sample_ns) if track.contradiction is not Reason.NONE else attitude
        while following is not None and following.t_told_ns <= sample.t_arrival_ns:
            track.add_camera_step(following.step)
            if track.contradiction is Reason.NONE:
                track.checkpoint()
            following = next(steps, None)


class PairOff(NamedTuple):
    """By what share a calibration's baseline is too long, and by what angle ε its toe-in is off; and by what share that
    makes distances too long where the corners are, δZ/Z = δB/B − ε Z/B."""

    baseline: float
    toe_in_rad: float
    distances: float


def pair_off(unit: Unit, calibration: Calibration) -> PairOff:
    """Return by what a calibration's pair is off from the unit's own."""
    known, true = calibration.stereo.X_RL, unit.stereo.X_RL
    toe_in_rad = float(Rotation.from_matrix(np.array(known.R) @ np.array(true.R).T).as_rotvec()[1])
    baseline_m, true_m = (float(np.linalg.norm(X_RL.p_m)) for X_RL in (known, true))
    longer = baseline_m / true_m - 1.0
    return PairOff(longer, toe_in_rad, longer - toe_in_rad * CORNERS_Z_M / baseline_m)


def depth_error(unit: Unit, calibration: Calibration) -> float:
    """Return the relative error of distances: of toe-in and baseline as the calibration leaves them."""
    return pair_off(unit, calibration).distances
