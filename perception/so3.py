"""Rotations: the exponential map of SO(3), unit quaternions (w, x, y, z) and their matrices.

A quaternion q_AB and its matrix R_AB take vectors from B to A. Functions on tuples of floats serve the filters that
run once per sample; functions on arrays serve everything else. Formulae: Solà, "Quaternion kinematics for the
error-state Kalman filter", arXiv:1711.02508.
"""

import math

import numpy as np

from messages import Quaternion, Vec3
from messages.arrays import FloatArray

Rows = tuple[float, float, float, float, float, float, float, float, float]
"""A 3×3 matrix, row by row."""


IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)

_SMALL_ANGLE_RAD = 1e-4
_SMALL_ANGLE_OF_SERIES_RAD = 1e-3


def skew(v: FloatArray) -> FloatArray:
    """Return [v]×, the (3, 3) matrix with [v]× u = v × u."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def exp(rotvec: FloatArray) -> FloatArray:
    """Return the (3, 3) rotation by |rotvec| radians about rotvec (Rodrigues)."""
    x, y, z = rotvec
    return matrix_from_quaternion(quaternion_from_rotvec((float(x), float(y), float(z))))


def log(R: FloatArray) -> FloatArray:
    """Return the rotation vector (3,) of the rotation matrix `R`, its angle in [0, π]."""
    return np.array(rotvec_from_quaternion(quaternion_from_matrix(R)))


def quaternion_from_rotvec(rotvec: Vec3) -> Quaternion:
    """Return the unit quaternion of the rotation by |rotvec| radians about rotvec."""
    x, y, z = rotvec
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < _SMALL_ANGLE_RAD:
        half_sinc = 0.5 - angle * angle / 48.0
        return (1.0 - angle * angle / 8.0, half_sinc * x, half_sinc * y, half_sinc * z)
    half_sinc = math.sin(0.5 * angle) / angle
    return (math.cos(0.5 * angle), half_sinc * x, half_sinc * y, half_sinc * z)


def rotvec_from_quaternion(q: Quaternion) -> Vec3:
    """Return the rotation vector of `q`, its angle in [0, π]."""
    w, x, y, z = positive(q)
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > _SMALL_ANGLE_RAD else 2.0 / w
    return (scale * x, scale * y, scale * z)


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the product p ⊗ q: q_AC = q_AB ⊗ q_BC."""
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse of the unit quaternion `q`: q_BA from q_AB."""
    w, x, y, z = q
    return (w, -x, -y, -z)


def normalised(q: Quaternion) -> Quaternion:
    """Return `q` scaled to unit length. Raises ZeroDivisionError for the zero quaternion."""
    w, x, y, z = q
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return (scale * w, scale * x, scale * y, scale * z)


def positive(q: Quaternion) -> Quaternion:
    """Return whichever of q and −q, the same rotation, has w ≥ 0."""
    w, x, y, z = q
    return q if w >= 0.0 else (-w, -x, -y, -z)


def slerp(p: Quaternion, q: Quaternion, share: float) -> Quaternion:
    """Return the rotation `share` of the shorter way from `p` (0) to `q` (1); beyond that range it extrapolates."""
    x, y, z = rotvec_from_quaternion(multiply(conjugate(p), q))
    return positive(normalised(multiply(p, quaternion_from_rotvec((share * x, share * y, share * z)))))


def rows_from_quaternion(q: Quaternion) -> Rows:
    """Return the rotation matrix of the unit quaternion `q` as nine numbers, row by row."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


def transform(rows: Rows, v: Vec3) -> Vec3:
    """Return the product of the matrix `rows` and `v`."""
    a, b, c, d, e, f, g, h, i = rows
    x, y, z = v
    return (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z)


def matrix_from_quaternion(q: Quaternion) -> FloatArray:
    """Return the (3, 3) rotation matrix of the unit quaternion `q`."""
    return np.array(rows_from_quaternion(q)).reshape(3, 3)


def matrices_from_rotvecs(rotvecs: FloatArray) -> FloatArray:
    """Return the (n, 3, 3) rotations by |rotvec| radians about each of the (n, 3) `rotvecs`."""
    square = (rotvecs * rotvecs).sum(axis=1)
    angle = np.sqrt(square)
    small = angle <= _SMALL_ANGLE_OF_SERIES_RAD
    series = 0.5 - square / 48.0 + square * square / 3840.0
    half_sinc = np.where(small, series, np.sin(0.5 * angle) / np.where(small, 1.0, angle))
    w, (x, y, z) = np.cos(0.5 * angle), (half_sinc[:, None] * rotvecs).T
    rows = (
        (x * x - y * y - z * z + w * w, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), -x * x + y * y - z * z + w * w, 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), -x * x - y * y + z * z + w * w),
    )
    return np.ascontiguousarray(np.array(rows).transpose(2, 0, 1))


def pair_covariance_turned(R: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of two vectors, one after the other, once both are multiplied by `R` (3, 3)."""
    blocks = covariance.reshape(2, 3, 2, 3).transpose(0, 2, 1, 3)
    turned: FloatArray = (R @ blocks @ R.T).transpose(0, 2, 1, 3).reshape(6, 6)
    return turned


def quaternion_from_matrix(R: FloatArray) -> Quaternion:
    """Return the unit quaternion, w ≥ 0, of the (3, 3) rotation matrix `R` (largest-component branch of Shepperd)."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    trace = a + e + i
    if trace >= max(a, e, i):
        q = (1.0 + trace, h - f, c - g, d - b)
    elif a >= max(e, i):
        q = (h - f, 1.0 + a - e - i, b + d, c + g)
    elif e >= i:
        q = (c - g, b + d, 1.0 + e - a - i, f + h)
    else:
        q = (d - b, c + g, f + h, 1.0 + i - a - e)
    return positive(normalised(q))


def quaternion_from_up(up_B: Vec3) -> Quaternion:
    """Return the q_WB of smallest angle that takes the direction `up_B`, of any length, to the W's z axis.

    Raises ValueError where `up_B` is zero: it then says nothing about the vertical.
    """
    x, y, z = up_B
    norm = math.sqrt(x * x + y * y + z * z)
    if norm == 0.0:
        raise ValueError("up_B is the zero vector; it must point away from the ground")
    level = math.hypot(x, y)
    if z >= 0.0:
        return normalised((norm + z, y, -x, 0.0))
    if level == 0.0:
        return (0.0, 1.0, 0.0, 0.0)
    # norm + z = level² / (norm − z), which near the antipode loses no digits
    return normalised((level / (norm - z), y / level, -x / level, 0.0))
