"""What the filter takes its sensors' errors for, with variances: what it starts from, and what it has made of it."""

from typing import NamedTuple

from messages import Vec3


class SensorErrors(NamedTuple):
    """Biases in B of gyroscope (rad/s) and accelerometer (m/s²), the scale error of the camera's distances, and the
    variance of each, on each axis."""

    gyro_bias: Vec3
    gyro_var: Vec3
    sf_bias: Vec3
    sf_var: Vec3
    scale: float
    scale_var: float
