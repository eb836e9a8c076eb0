"""What a recording can tell of each of the ten parameters, and what it cannot.

The parameters a person reads are η = (m, x0, y0, z0, J_xx, J_yy, J_zz, J_yz, J_xz, J_xy), the centre of gravity d = h /
m and the tensor about it

    J = J_O − (hᵀh 1 − h hᵀ) / m                                                                                  (1)

With the information F about π, cov η = (∂η/∂π) F⁻¹ (∂η/∂π)ᵀ: at the true motion this is the Cramér-Rao bound.

A parameter is called identifiable if its 95 % interval at least halves what being a rigid body says already. The half
ranges that a body of this size leaves are m itself; the radius of gyration for x0, y0, z0; the lesser of the two other
moments for a moment (triangle inequality); half of J_c for the product J_ab.
"""

from dataclasses import dataclass

import numpy as np

from impedance.body.physical import pseudo_inertia
from impedance.body.rigid_body import TENSOR_ORDER, Inertia, six_of
from messages.arrays import BoolArray, FloatArray
from messages.constants import NORMAL_95

NAMES = ("m", "x0", "y0", "z0", *(f"J{pair}" for pair in TENSOR_ORDER))
UNITS = ("kg", *("m",) * 3, *("kg m²",) * 6)
_IDENTIFIABLE_SHARE = 0.5
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_WORTH_A_WORD = 0.1


@dataclass(frozen=True)
class Observability:
    """What is known of the ten parameters: `deviation` (10,), standard deviations, infinite where nothing is known.

    `range` (10,) are the half ranges of a rigid body of this size and `identifiable` (10,) follows from them.
    `singular_values` (10,) are those of the whitened regressor in units of these ranges, the greatest first, and `null`
    (10,) the direction of the least, in the same units: what changes together without the wrench telling.
    """

    deviation: FloatArray
    covariance: FloatArray
    range: FloatArray
    identifiable: BoolArray
    singular_values: FloatArray
    null: FloatArray

    @property
    def null_words(self) -> str:
        """Return the direction of the least singular value, in units of the parameters, for a person."""
        step = self.null * self.range / np.abs(self.null).max()
        told = [
            i for i in np.argsort(-np.abs(self.null)) if abs(self.null[i]) > _WORTH_A_WORD * np.abs(self.null).max()
        ]
        return " with ".join(f"{NAMES[i]} {step[i]:+.3g} {UNITS[i]}" for i in told)


def about_cog(vector: FloatArray) -> FloatArray:
    """Return η (10,) of π (10,), by (1)."""
    body = Inertia.from_vector(vector)
    return np.concatenate(([body.mass_kg], body.cog_m, body.about_cog()))


def about_cog_slope(vector: FloatArray) -> FloatArray:
    """Return ∂η/∂π (10, 10)."""
    m, h = vector[0], vector[1:4]
    slope = np.eye(10)
    slope[1:4, 0] = -h / m**2
    slope[1:4, 1:4] = np.eye(3) / m
    slope[4:, 0] = six_of((h @ h * np.eye(3) - np.outer(h, h)) / m**2)
    for k, unit in enumerate(np.eye(3)):
        slope[4:, 1 + k] = -six_of(2.0 * h[k] * np.eye(3) - np.outer(unit, h) - np.outer(h, unit)) / m
    return slope


def moving(origin_m: FloatArray) -> FloatArray:
    """Return the matrix (10, 10) that takes π to another origin (3,), given in the old frame; the axes stay."""
    r, unit = origin_m, np.eye(3)
    matrix = np.eye(10)
    matrix[1:4, 0] = -r
    matrix[4:, 0] = six_of(r @ r * unit - np.outer(r, r))
    for k in range(3):
        matrix[4:, 1 + k] = six_of(-2.0 * r[k] * unit + np.outer(unit[k], r) + np.outer(r, unit[k]))
    return matrix


def observed(vector: FloatArray, covariance: FloatArray) -> Observability:
    """Return what covariance (10, 10) of π (10,), a consistent body, lets be known of η.

    A covariance with infinite entries, or none at all, is given by the inverse of an information that is singular: use
    `covariance_of`, which puts a bound far beyond every range in its place.
    """
    slope = about_cog_slope(vector)
    of_eta = slope @ covariance @ slope.T
    deviation = np.sqrt(np.maximum(np.diag(of_eta), 0.0))
    half_range = rigid_range(vector)
    scaled = of_eta / np.outer(half_range, half_range)
    values, directions = np.linalg.eigh(0.5 * (scaled + scaled.T))
    return Observability(
        deviation=deviation,
        covariance=of_eta,
        range=half_range,
        identifiable=deviation * NORMAL_95 <= _IDENTIFIABLE_SHARE * half_range,
        singular_values=1.0 / np.sqrt(np.maximum(values, np.finfo(float).tiny)),
        null=directions[:, -1] * np.sign(directions[np.argmax(np.abs(directions[:, -1])), -1]),
    )


def covariance_of(information: FloatArray, scale: FloatArray) -> FloatArray:
    """Return F⁻¹ (10, 10), with directions of which nothing is known bounded at a million times `scale` (10,)."""
    values, directions = np.linalg.eigh(information * np.outer(scale, scale))
    half = directions / np.sqrt(np.maximum(values, _NOTHING))
    covariance: FloatArray = scale[:, None] * (half @ half.T) * scale
    return covariance


def rigid_range(vector: FloatArray) -> FloatArray:
    """Return the half ranges (10,) of the parameters of a rigid body of about this size."""
    eta = about_cog(vector)
    xx, yy, zz = eta[4:7]
    gyration = np.sqrt(0.5 * (xx + yy + zz) / eta[0])
    moments = [min(yy, zz), min(xx, zz), min(xx, yy)]
    return np.array([eta[0], *(gyration,) * 3, *moments, 0.5 * xx, 0.5 * yy, 0.5 * zz])


def vector_scale(vector: FloatArray) -> FloatArray:
    """Return the sizes (10,) of the entries of π of a consistent body: what a singular information is scaled by."""
    P = pseudo_inertia(vector)
    size = np.sqrt(np.diag(P))
    moments = np.maximum(vector[4:7], 0.0)
    return np.array(
        [vector[0], *(size[:3] * size[3]), *moments, *(np.sqrt(moments[i] * moments[j]) for i, j in _PAIRS[3:])]
    )


_NOTHING = 1e-12
