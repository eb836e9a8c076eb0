"""What the filter takes its sensors' errors for, with variances: what it starts from, and what it has made of it."""

from typing import NamedTuple

from messages import Vec3
from messages.arrays import FloatArray


class MountingErrors(NamedTuple):
    """What the calibration has wrong of the camera: the small turn (3,) rad by which it stands otherwise in B, its
    covariance (3, 3), by how much later than stamped its pictures are, and by what share its distances are too long,
    each with its variance: of the scale with what the odometer and the accelerometer's own scale leave of it."""

    turn_B: Vec3
    turn_covariance: FloatArray
    lag_s: float
    lag_var: float
    scale: float
    scale_var: float


class SensorErrors(NamedTuple):
    """Biases in B of gyroscope (rad/s) and accelerometer (m/s²), the scale error of the camera's distances, and the
    variance of each, on each axis."""

    gyro_bias: Vec3
    gyro_var: Vec3
    sf_bias: Vec3
    sf_var: Vec3
    scale: float
    scale_var: float
