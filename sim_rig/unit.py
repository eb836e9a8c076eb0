"""One GaitEyes unit as it was built, and the calibration file that its maker would have written for it.

Frames: B the IMU, fixed midway between the cameras; nominally x along the cameras' optical axes, y to the wearer's
left, z up out of the camera's top (so 45° of pitch tilts B as a whole). L, R the raw cameras.

Lens and pair tolerances follow eight factory calibrations of ZED cameras at 1280×720: f 698.6 ± 2.3 px,
k1 −0.174 ± 0.005, k2 0.027 ± 0.002, p1, p2 within ±0.0005, baseline 120.0 mm; principal points and pair rotations are
kept to the better half of what those files show.
"""

from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from calib.nominal import R_BL_NOMINAL
from messages import NO_RESIDUAL, Calibration, ImuCalibration, Lens, Pose, Residual, StereoCalibration, matrix3, vec3
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.imu.chip_unit import ZERO_G_LIMIT_MPS2_PER_K, ChipUnit, draw_chip_unit

WIDTH_PX, HEIGHT_PX = 1280, 720

RESIDUAL = Residual(
    specific_force_mps2=1.5e-3 * STANDARD_GRAVITY_MPS2,
    scale=0.0005,
    toe_in_rad=float(np.deg2rad(0.01)),
    camera_to_imu_rad=float(np.deg2rad(0.05)),
    time_s=0.5e-3,
    focal_length=1e-4,
    baseline=5e-4,
    specific_force_mps2_per_K=float(ZERO_G_LIMIT_MPS2_PER_K.max()) / 3.0,
)
"""One standard deviation of what a careful calibration leaves behind, per axis and per eye. The accelerometer's bias is
that at the die's own temperature."""

_ROW_TIME_S = 16.0e-3 / HEIGHT_PX
_HALF_BASELINE_M = 0.060


@dataclass(frozen=True)
class Unit:
    """The true values of one unit. `gain` is the brightness of the left and the right image."""

    name: str
    chip: ChipUnit
    stereo: StereoCalibration
    X_BL: Pose
    gain: tuple[float, float]

    def exact_calibration(self) -> Calibration:
        """Return the true values as a calibration, with no residual."""
        return Calibration(
            unit=self.name,
            imu=ImuCalibration(
                sf_matrix=matrix3(np.linalg.inv(self.chip.sf_matrix)),
                sf_bias_mps2=vec3(self.chip.sf_bias_mps2),
                w_matrix=matrix3(np.linalg.inv(self.chip.w_matrix)),
                w_bias_radps=vec3(self.chip.w_bias_radps),
                temperature_degC=self.chip.temperature_degC,
            ),
            stereo=self.stereo,
            X_BL=self.X_BL,
            residual=NO_RESIDUAL,
        )

    def calibration(self, rng: np.random.Generator, residual: Residual = RESIDUAL) -> Calibration:
        """Return what a calibration would find that leaves `residual`: the true values plus one draw of that.

        No rows are deformed, whatever it says, and the accelerometer's bias is that at its die's temperature.
        """
        exact = self.exact_calibration()
        replace = msgspec.structs.replace

        def axes(sigma: float) -> FloatArray:
            return rng.normal(0.0, sigma, 3)

        def matrix(sigma: float) -> FloatArray:
            error = cross_axis.normal(0.0, sigma, (3, 3))
            np.fill_diagonal(error, axes(sigma))
            return np.eye(3) + error

        (cross_axis,) = rng.spawn(1)
        imu = replace(
            exact.imu,
            sf_bias_mps2=vec3(self.chip.sf_bias_mps2 + axes(residual.specific_force_mps2)),
            sf_matrix=matrix3(matrix(residual.scale) @ exact.imu.sf_matrix),
            w_matrix=matrix3(matrix(residual.scale) @ exact.imu.w_matrix),
        )
        toe_in = Rotation.from_rotvec([0.0, rng.normal(0.0, residual.toe_in_rad), 0.0])
        X_RL = replace(self.stereo.X_RL, R=matrix3(toe_in.as_matrix() @ self.stereo.X_RL.R))
        time_s = self.stereo.stamp_to_mid_exposure_s + rng.normal(0.0, residual.time_s)
        mounting = Rotation.from_rotvec(axes(residual.camera_to_imu_rad))
        left, right = (
            _with_focal_length(lens, 1.0 + rng.normal(0.0, residual.focal_length_std))
            for lens in (self.stereo.left, self.stereo.right)
        )
        longer = 1.0 + rng.normal(0.0, residual.baseline_std)
        X_RL = replace(X_RL, p_m=vec3(longer * np.array(X_RL.p_m)))
        return replace(
            exact,
            imu=imu,
            stereo=replace(self.stereo, left=left, right=right, X_RL=X_RL, stamp_to_mid_exposure_s=time_s),
            X_BL=replace(self.X_BL, R=matrix3(mounting.as_matrix() @ self.X_BL.R)),
            residual=residual,
        )


def _with_focal_length(lens: Lens, times: float) -> Lens:
    return msgspec.structs.replace(lens, fx_px=times * lens.fx_px, fy_px=times * lens.fy_px)


def draw_unit(seed: int, *, rolling_shutter: bool = True) -> Unit:
    """Return the unit that `seed` stands for, within the tolerances of the datasheets."""
    rng = np.random.default_rng([seed, 1])

    def within(limit: float) -> float:
        return float(np.clip(rng.normal(0.0, limit / 2), -limit, limit))

    def rotation(limit_deg: float) -> FloatArray:
        return Rotation.from_rotvec(np.deg2rad([within(limit_deg) for _ in range(3)])).as_matrix()

    left, right = (
        Lens(
            width_px=WIDTH_PX,
            height_px=HEIGHT_PX,
            fx_px=(f_px := 698.6 + within(5.0)),
            fy_px=f_px,
            cx_px=(WIDTH_PX - 1) / 2 + within(15.0),
            cy_px=(HEIGHT_PX - 1) / 2 + within(15.0),
            distortion=(-0.174 + within(0.01), 0.027 + within(0.004), within(0.0004), within(0.0008), 0.0),
        )
        for _ in range(2)
    )
    stereo = StereoCalibration(
        left=left,
        right=right,
        X_RL=Pose(
            R=matrix3(rotation(0.3)),
            p_m=(-2 * _HALF_BASELINE_M + within(0.0003), within(0.00005), within(0.0003)),
        ),
        row_time_s=_ROW_TIME_S if rolling_shutter else 0.0,
        stamp_to_mid_exposure_s=-0.012 + within(0.004),
    )
    X_BL = Pose(
        R=matrix3(rotation(1.5) @ R_BL_NOMINAL),
        p_m=(within(0.003), _HALF_BASELINE_M + within(0.003), within(0.003)),
    )
    gain = (1.0 + within(0.03), 1.0 + within(0.03))
    return Unit(name=f"rig-{seed}", chip=draw_chip_unit(rng), stereo=stereo, X_BL=X_BL, gain=gain)
