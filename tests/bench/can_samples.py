"""Messages for the tests of the publishers and the CAN codec."""

from typing import Any, Final

import msgspec

from messages import (
    Attitude,
    Calibration,
    CanBusHealth,
    DropCause,
    GaitPhase,
    GroundPlane,
    Health,
    ImuCalibration,
    Lens,
    Load,
    Matrix3,
    Motion,
    NextFoothold,
    Pose,
    PropagatedGround,
    Reason,
    RecordingState,
    Residual,
    Setpoint,
    Side,
    Source,
    Stamp,
    Status,
    StereoCalibration,
    Terrain,
    TerrainEdge,
    TerrainKind,
    TerrainObstacle,
)

NAN = float("nan")

_SEEN: Final[dict[str, Any]] = {
    "t_exposure_ns": 1_000_000_000,
    "frame_seq": 3,
    "status": Status.VALID,
    "reason": Reason.NONE,
    "calibration_id": "a3f01234",
}
"""What every estimate of a frame says of it."""


def ground(**changes: object) -> GroundPlane:
    valid = GroundPlane(
        **_SEEN,
        slope_sagittal_rad=0.1,
        slope_frontal_rad=-0.05,
        height_m=0.931,
        covariance=(1e-4, 0.0, 0.0, 4e-4, 0.0, 9e-6),
        ahead_m=0.6,
        matched_share=0.9,
        inlier_share=0.8,
        disparity_noise_px=0.1,
    )
    return msgspec.structs.replace(valid, **changes)


def invalid_ground(status: Status = Status.INVALID, reason: Reason = Reason.NO_FRAME) -> GroundPlane:
    invalid = GroundPlane.invalid(
        t_exposure_ns=1_000_000_000, frame_seq=3, reason=Reason.NO_FRAME, ahead_m=0.6, calibration_id="a3f01234"
    )
    return msgspec.structs.replace(invalid, status=status, reason=reason)


def propagated_ground(**changes: object) -> PropagatedGround:
    valid = PropagatedGround(
        t_sample_ns=1_000_000_000,
        picture_age_s=0.0624,
        status=Status.VALID,
        reason=Reason.NONE,
        slope_sagittal_rad=0.09,
        slope_frontal_rad=-0.06,
        height_m=0.917,
        covariance=(1e-4, 0.0, 0.0, 4e-4, 0.0, 1.6e-5),
        calibration_id="a3f01234",
    )
    return msgspec.structs.replace(valid, **changes)


def attitude() -> Attitude:
    return Attitude(
        t_sample_ns=1_000_000_000,
        status=Status.VALID,
        reason=Reason.NONE,
        q_WB=(1.0, 0.0, 0.0, 0.0),
        w_WB_B_radps=(0.0, 0.1, 0.0),
        gyro_bias_B_radps=(0.0, 0.0, 0.001),
        rotation_cov_W_rad2=(1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-2),
        calibration_id="a3f01234",
    )


def motion(**changes: object) -> Motion:
    valid = Motion(
        **_SEEN,
        velocity_H_mps=(1.2, 0.05, -0.1),
        rate_H_radps=(0.01, -0.2, 0.3),
        distance_m=12.5,
        velocity_cov_H=(2.5e-5, 0.0, 0.0, 2.5e-5, 0.0, 2.5e-5),
        rate_cov_H=(4e-6, 0.0, 0.0, 4e-6, 0.0, 4e-6),
        distance_var_m2=1e-3,
        ground_moves=False,
    )
    return msgspec.structs.replace(valid, **changes)


def terrain(**changes: object) -> Terrain:
    step = TerrainEdge(distance_m=1.1, distance_sd_m=0.01, rise_m=0.17, rise_sd_m=0.003, bound_only=False, yaw_rad=0.02)
    post = TerrainObstacle(distance_m=0.8, left_m=-0.2, height_m=0.5)
    foothold = NextFoothold(
        side=Side.RIGHT,
        ahead_m=0.62,
        ahead_sd_m=0.03,
        left_m=-0.09,
        left_sd_m=0.02,
        slope_sagittal_rad=0.01,
        slope_sagittal_sd_rad=0.004,
        slope_frontal_rad=-0.01,
        slope_frontal_sd_rad=0.005,
        height_m=0.95,
        height_sd_m=0.004,
        rise_m=0.0,
        rise_sd_m=0.005,
        time_to_contact_s=0.3,
        time_to_contact_sd_s=0.02,
    )
    valid = Terrain(
        **_SEEN,
        kind=TerrainKind.STEP_UP,
        probability=0.9,
        edges=(step,),
        obstacles=(post,),
        foothold=foothold,
    )
    return msgspec.structs.replace(valid, **changes)


def setpoint(**changes: object) -> Setpoint:
    valid = Setpoint(
        **_SEEN,
        phase=GaitPhase.SWING,
        kind=TerrainKind.RAMP_UP,
        slope_rad=0.1,
        slope_sd_rad=0.01,
        equilibrium_rad=(0.0, 0.05, 0.1, 0.05, -0.1),
        equilibrium_sd_rad=(0.02,) * 5,
        stiffness_nm_per_rad=(100.0, 200.0, 300.0, 500.0, 80.0),
        stiffness_sd_nm_per_rad=(20.0,) * 5,
        damping_nms_per_rad=(1.0, 2.0, 2.0, 2.0, 1.0),
        damping_sd_nms_per_rad=(0.5,) * 5,
        table_id="0123abcd",
    )
    return msgspec.structs.replace(valid, **changes)


def health(**changes: object) -> Health:
    calm = Health(
        t_ns=5_000_000_000,
        imu_samples=500,
        imu_lost=1,
        imu_refused=0,
        imu_clipped=0,
        imu_bus_errors=2,
        imu_fifo_overflows=0,
        imu_frames_refused=0,
        imu_resets=0,
        imu_edges_missed=0,
        frames=100,
        frames_valid=95,
        frames_dropped={DropCause.SUPERSEDED: 3, DropCause.CORRUPT: 4},
        refused={Reason.LOW_TEXTURE: 5},
        ankle_states=0,
        inbox_dropped=0,
        recorder_dropped=0,
        recording=RecordingState.OFF,
        can_errors=0,
        can_bus=CanBusHealth(),
        zenoh_errors=0,
        load=Load.REDUCED,
        calibration_id="a3f01234",
        learnt_id="",
        height_off_m=0.012,
    )
    return msgspec.structs.replace(calm, **changes)


def stamp(**changes: object) -> Stamp:
    live = Stamp(device="unit-1", boot_id="boot", source=Source.LIVE, seq=0, t_publish_ns=1_040_000_000, age_s=0.040)
    return msgspec.structs.replace(live, **changes)


def calibration() -> Calibration:
    unit: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    here = Pose(R=unit, p_m=(0.0, 0.0, 0.0))
    zero = (0.0, 0.0, 0.0)
    lens = Lens(
        width_px=1280,
        height_px=720,
        fx_px=700.0,
        fy_px=700.0,
        cx_px=640.0,
        cy_px=360.0,
        distortion=(0.0, 0.0, 0.0, 0.0),
    )
    return Calibration(
        unit="unit-1",
        imu=ImuCalibration(sf_matrix=unit, sf_bias_mps2=zero, w_matrix=unit, w_bias_radps=zero),
        stereo=StereoCalibration(left=lens, right=lens, X_RL=Pose(R=unit, p_m=(-0.12, 0.0, 0.0))),
        X_BL=here,
        residual=Residual(),
    )
