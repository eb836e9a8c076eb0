"""The calibration of one unit, as named-frame structs. `calib` reads, checks and writes them as YAML.

Frames: B the IMU, L and R the raw left and right cameras, D a depth camera (x right, y down, z forward). The
rectified left camera C is derived from L and R by perception; for a depth camera C is D.
"""

import hashlib
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from messages.constants import STANDARD_GRAVITY_MPS2
from messages.inputs import Vec3

Matrix3 = tuple[Vec3, Vec3, Vec3]


def vec3(values: ArrayLike) -> Vec3:
    """Return three numbers as a message's vector; raises ValueError for any other count."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def matrix3(values: ArrayLike) -> Matrix3:
    """Return a (3, 3) array as a message's matrix, row by row; raises ValueError for any other shape."""
    top, middle, bottom = np.asarray(values, dtype=np.float64)
    return vec3(top), vec3(middle), vec3(bottom)


PixelCount = Annotated[int, msgspec.Meta(ge=16, le=8192)]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class Pose(msgspec.Struct, frozen=True, kw_only=True):
    """X_AB: `R` takes vectors from B to A, `p_m` is B's origin seen from A."""

    R: Matrix3
    p_m: Vec3


class Lens(msgspec.Struct, frozen=True, kw_only=True):
    """Pinhole with radial-tangential distortion (k1, k2, p1, p2, k3 …) in OpenCV's order (4, 5, 8, 12 or 14 terms)."""

    width_px: PixelCount
    height_px: PixelCount
    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...]


class StereoCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """Two raw cameras. `X_RL` takes points from L to R. `row_time_s` is 0 for a global shutter.

    `stamp_to_mid_exposure_s` is added to the device's frame stamp to reach mid-exposure of the middle row.
    """

    left: Lens
    right: Lens
    X_RL: Pose
    row_time_s: NonNegative = 0.0
    stamp_to_mid_exposure_s: float = 0.0

    @property
    def lens(self) -> Lens:
        """Return the lens of the camera whose optical centre is the origin of H."""
        return self.left


def reduced_lens(lens: Lens, divisor: int) -> Lens:
    """Return the lens of a picture of which `divisor` × `divisor` pixels are taken together, whose centres are at whole
    numbers."""
    return msgspec.structs.replace(
        lens,
        width_px=lens.width_px // divisor,
        height_px=lens.height_px // divisor,
        fx_px=lens.fx_px / divisor,
        fy_px=lens.fy_px / divisor,
        cx_px=(lens.cx_px + 0.5) / divisor - 0.5,
        cy_px=(lens.cy_px + 0.5) / divisor - 0.5,
    )


def reduced_stereo(stereo: StereoCalibration, divisor: int) -> StereoCalibration:
    """Return the same cameras, of whose pixels `divisor` × `divisor` are read out together."""
    return msgspec.structs.replace(
        stereo,
        left=reduced_lens(stereo.left, divisor),
        right=reduced_lens(stereo.right, divisor),
        row_time_s=stereo.row_time_s * divisor,
    )


class DepthCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """A camera that delivers depth along its optical axis, in steps of `step_m`, as seen through `lens`.

    Its depth stems from a stereo pair of its own with `baseline_m`, so that a noise of σ px of disparity shows as
    z²/(f·baseline) σ. `scale_residual` is one standard deviation of the relative error of all its depths.
    `row_time_s` and `stamp_to_mid_exposure_s` are as for a stereo pair.
    """

    lens: Lens
    baseline_m: Positive
    step_m: Positive = 0.001
    scale_residual: NonNegative = 0.0
    row_time_s: NonNegative = 0.0
    stamp_to_mid_exposure_s: float = 0.0


class ImuCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """Corrected value = matrix · (measured − bias), for specific force and angular rate, in B.

    `temperature_degC` is the die's when the accelerometer's bias was found; unset where a file does not tell.
    """

    sf_matrix: Matrix3
    sf_bias_mps2: Vec3
    w_matrix: Matrix3
    w_bias_radps: Vec3
    temperature_degC: float | msgspec.UnsetType = msgspec.UNSET

    @property
    def calibrated_at(self) -> tuple[float, float]:
        """Return the die's temperature, °C, when the accelerometer's bias was found, and its deviation, K."""
        if isinstance(self.temperature_degC, msgspec.UnsetType):
            return USUAL_CALIBRATION_DEGC
        return self.temperature_degC, 0.0


USUAL_CALIBRATION_DEGC = (30.0, 5.0)
"""A die in a room, some 8 K warmer than its air; one standard deviation of it, K."""


class Residual(msgspec.Struct, frozen=True, kw_only=True):
    """One standard deviation of what the calibration leaves behind.

    `scale` is that of each element of the IMU's matrices: of an axis's scale, and of its sensitivity across it.
    `toe_in_rad` is the angle between the optical axes of the pair, that inside a depth camera too; `rows_rad` by how
    much what lenses and rectification leave moves one eye's picture against the other's, here and there.
    `focal_length` is relative, of each eye, independently; `baseline` relative. `specific_force_mps2_per_K` is by what
    the accelerometer's bias changes with each kelvin of its die, on each axis.

    What a file does not state, as those written before these terms existed, is unset, and leaves the calibration's id
    as it was; the properties `*_std` then are the defaults below.
    """

    specific_force_mps2: NonNegative = 0.0
    scale: NonNegative = 0.0
    toe_in_rad: NonNegative = 0.0
    rows_rad: NonNegative = 0.0
    camera_to_imu_rad: NonNegative = 0.0
    time_s: NonNegative = 0.0
    focal_length: NonNegative | msgspec.UnsetType = msgspec.UNSET
    baseline: NonNegative | msgspec.UnsetType = msgspec.UNSET
    specific_force_mps2_per_K: NonNegative | msgspec.UnsetType = msgspec.UNSET

    @property
    def focal_length_std(self) -> float:
        """Return the relative deviation of each eye's focal length."""
        return _stated(self.focal_length, USUAL_FOCAL_LENGTH)

    @property
    def baseline_std(self) -> float:
        """Return the relative deviation of the baseline."""
        return _stated(self.baseline, USUAL_BASELINE)

    @property
    def sf_per_K_std_mps2(self) -> float:
        """Return the deviation of the accelerometer's change per kelvin, on each axis."""
        return _stated(self.specific_force_mps2_per_K, USUAL_SF_MPS2_PER_K)


USUAL_FOCAL_LENGTH = 3e-4
"""A fifth of a pixel of 700: what calibrating with a target leaves of a focal length."""
USUAL_BASELINE = 2.5e-3
"""0.3 mm of 120: the spread of eight makers' calibrations of ZED cameras about the nominal baseline."""
USUAL_SF_MPS2_PER_K = 0.5 * 60e-3 / 70.0 * STANDARD_GRAVITY_MPS2
"""Half of ±60 mg from 0 to 70 °C, the z axis, which is the worst [MPU-6000 and MPU-6050 Product Specification,
PS-MPU-6000A-00 rev. 3.4, table 6.2: zero-g level change vs. temperature; x and y ±35 mg]: typical values, of which no
maximum is told."""
NO_RESIDUAL = Residual(focal_length=0.0, baseline=0.0, specific_force_mps2_per_K=0.0)
"""Of a calibration that is exactly true, as only a simulation's can be."""


def _stated(value: float | msgspec.UnsetType, usual: float) -> float:
    return usual if isinstance(value, msgspec.UnsetType) else value


CAMERA_HEIGHTS_M = (0.5, 1.6)
"""How high above the ground a camera may be worn: from one who sits to one who is tall and has it at the chest."""


class WearerHeight(msgspec.Struct, frozen=True, kw_only=True):
    """How high above the ground the camera is on its wearer, who stands upright, with one standard deviation."""

    camera_height_m: Annotated[float, msgspec.Meta(ge=CAMERA_HEIGHTS_M[0], le=CAMERA_HEIGHTS_M[1])]
    std_m: Annotated[float, msgspec.Meta(gt=0.0, le=0.1)]


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """Everything the daemon knows about a stereo unit. `X_BL` is the pose of the raw left camera in the IMU frame.

    `wearer` is who wears it, where that has been measured.
    """

    unit: str
    imu: ImuCalibration
    stereo: StereoCalibration
    X_BL: Pose
    residual: Residual
    wearer: WearerHeight | msgspec.UnsetType = msgspec.UNSET

    @property
    def id(self) -> str:
        """Eight hexadecimal digits that change whenever any value does, the same before and after a file."""
        return short_hash(self)

    @property
    def camera(self) -> StereoCalibration:
        """Return what makes the frames."""
        return self.stereo

    @property
    def X_BE(self) -> Pose:
        """Return the pose in B of the camera whose optical centre is the origin of H."""
        return self.X_BL


class DepthUnitCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """Everything the daemon knows about a unit with a depth camera, whose pose in the IMU frame is `X_BD`.

    `wearer` is who wears it, where that has been measured.
    """

    unit: str
    imu: ImuCalibration
    depth: DepthCalibration
    X_BD: Pose
    residual: Residual
    wearer: WearerHeight | msgspec.UnsetType = msgspec.UNSET

    @property
    def id(self) -> str:
        """Eight hexadecimal digits that change whenever any value does, the same before and after a file."""
        return short_hash(self)

    @property
    def camera(self) -> DepthCalibration:
        """Return what makes the frames."""
        return self.depth

    @property
    def X_BE(self) -> Pose:
        """Return the pose in B of the camera whose optical centre is the origin of H."""
        return self.X_BD


UnitCalibration = Calibration | DepthUnitCalibration


def short_hash(values: msgspec.Struct) -> str:
    """Return eight hexadecimal digits that change whenever any of the values does."""
    plain = msgspec.convert(msgspec.to_builtins(values), type(values))  # 1 and 1.0 are one value
    return hashlib.sha256(msgspec.json.encode(plain)).hexdigest()[:8]
