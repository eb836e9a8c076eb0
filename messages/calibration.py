"""The calibration of one unit, as named-frame structs. `calib` reads, checks and writes them as YAML.

Frames: B the IMU, L and R the raw left and right cameras (x right, y down, z forward). The rectified left
camera C is derived from these by perception.
"""

import hashlib
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import ArrayLike

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


class ImuCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """Corrected value = matrix · (measured − bias), for specific force and angular rate, in B."""

    sf_matrix: Matrix3
    sf_bias_mps2: Vec3
    w_matrix: Matrix3
    w_bias_radps: Vec3


class Residual(msgspec.Struct, frozen=True, kw_only=True):
    """One standard deviation of what the calibration leaves behind."""

    specific_force_mps2: NonNegative = 0.0
    scale: NonNegative = 0.0
    toe_in_rad: NonNegative = 0.0
    camera_to_imu_rad: NonNegative = 0.0
    time_s: NonNegative = 0.0


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """Everything the daemon knows about one unit. `X_BL` is the pose of the raw left camera in the IMU frame."""

    unit: str
    imu: ImuCalibration
    stereo: StereoCalibration
    X_BL: Pose
    residual: Residual

    @property
    def id(self) -> str:
        """Eight hexadecimal digits that change whenever any value does, the same before and after a file."""
        plain = msgspec.convert(msgspec.to_builtins(self), Calibration)  # 1 and 1.0 are one value
        return hashlib.sha256(msgspec.json.encode(plain)).hexdigest()[:8]
