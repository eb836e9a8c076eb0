"""An attitude track that is told samples of a perfect IMU and what a camera saw, and what it makes of them."""

from collections.abc import Callable, Container
from dataclasses import dataclass

import msgspec
import numpy as np

from messages import Calibration, ImuSample, Reason, vec3
from perception.attitude.camera_step import CameraStep
from perception.attitude.track import AttitudeTrack
from perception.motion.ego_motion import EgoMotion
from sim_rig.unit import RESIDUAL, draw_unit
from tests.bench.seen_motion import P_BC_M, R_BC, SampleAt, arrivals_until, calibration_of_the_camera, gait

Alter = Callable[[SampleAt | EgoMotion], SampleAt | EgoMotion]

_PERFECT = calibration_of_the_camera(draw_unit(4).exact_calibration())
CALIBRATION: Calibration = msgspec.structs.replace(_PERFECT, residual=RESIDUAL)


@dataclass(frozen=True)
class Followed:
    """After one step of the camera: the newest sample's time, the error of the vertical (NaN without an attitude), and
    what the track says."""

    t_ns: int
    tilt_deg: float
    reason: Reason
    ground_moves: bool
    scale: float


def follow(
    to_ns: int,
    alter: Alter | None = None,
    *,
    seed: int = 5,
    name: str = "level",
    lost: Container[int] = (),
    blind: Container[int] = (),
) -> list[Followed]:
    """Return what a track says after each step; samples at instants of `lost`, and steps from instants of `blind` on,
    do not come."""
    track, walk, followed, seq = AttitudeTrack(CALIBRATION), gait(seed, name), [], 0
    now_ns = 0
    for arrival in arrivals_until(to_ns, seed, name):
        message = arrival if alter is None else alter(arrival)
        if isinstance(message, SampleAt):
            if message.t_ns in lost:
                continue
            now_ns, seq = message.t_ns, seq + 1
            track.add_sample(measured(message, seq))
        elif message.t_before_ns not in blind:
            track.add_camera_step(camera_step(message))
            if track.contradiction is Reason.NONE:
                track.checkpoint()
            tilt_deg, attitude = float("nan"), track.at(now_ns)
            if attitude is not None:
                tilt_deg = float(
                    np.degrees(np.arccos(min(1.0, attitude.R_WB[2] @ walk.at(np.array([now_ns])).R_WB[0, 2])))
                )
            followed.append(Followed(now_ns, tilt_deg, track.contradiction, track.ground_moves, track.distance_scale))
    return followed


def measured(sample: SampleAt, seq: int) -> ImuSample:
    """Return what the unit's chip measures, without noise."""
    imu = CALIBRATION.imu
    return ImuSample(
        seq=seq,
        t_sample_ns=sample.t_ns,
        t_arrival_ns=sample.t_ns,
        sf_B_mps2=vec3(np.linalg.inv(imu.sf_matrix) @ sample.sf_B_mps2 + imu.sf_bias_mps2),
        w_WB_B_radps=vec3(np.linalg.inv(imu.w_matrix) @ sample.w_B_radps + imu.w_bias_radps),
        temperature_degC=25.0,
    )


def camera_step(motion: EgoMotion) -> CameraStep:
    """Return a motion of the camera as the track takes it."""
    duration_s = 1e-9 * (motion.t_after_ns - motion.t_before_ns)
    to_B = duration_s * np.kron(np.eye(2), R_BC)
    return CameraStep(
        motion.t_before_ns,
        motion.t_after_ns,
        vec3(duration_s * R_BC @ motion.w_C_radps),
        vec3(duration_s * R_BC @ motion.v_C_mps),
        to_B @ motion.covariance @ to_B.T,
        vec3(P_BC_M),
    )
