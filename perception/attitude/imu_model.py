"""A unit's IMU calibration applied to its samples."""

from typing import NamedTuple

from messages import ImuCalibration, ImuSample, Matrix3, Vec3


class CorrectedImu(NamedTuple):
    """Specific force and angular rate of B, in B, after the unit's calibration."""

    sf_B_mps2: Vec3
    w_WB_B_radps: Vec3


def corrected(sample: ImuSample, calibration: ImuCalibration) -> CorrectedImu:
    """Return matrix · (measured − bias) for both sensors of `sample`."""
    return CorrectedImu(
        _corrected(sample.sf_B_mps2, calibration.sf_matrix, calibration.sf_bias_mps2),
        _corrected(sample.w_WB_B_radps, calibration.w_matrix, calibration.w_bias_radps),
    )


def _corrected(measured: Vec3, matrix: Matrix3, bias: Vec3) -> Vec3:
    x, y, z = measured[0] - bias[0], measured[1] - bias[1], measured[2] - bias[2]
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z)
