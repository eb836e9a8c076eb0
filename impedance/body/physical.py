"""Physically consistent inertias: the body of positive mass that lies nearest in the metric of the information.

A rigid body's pseudo-inertia (Wensing, Kim and Slotine 2018)

    P(π) = [[Σ, h], [hᵀ, m]] ⪰ 0,   Σ = ½ tr(J) 1 − J,   h = m d                                                 (1)

is linear in its ten parameters π = (m, h, J_xx, J_yy, J_zz, J_yz, J_xz, J_xy), J the tensor about the origin. P ⪰ 0
says that the mass is positive and that the moments satisfy the triangle inequality. Where the best fit breaks (1),

    min ½ πᵀ F π − bᵀ π − μ Σ_bodies log det P(π),   μ → 0                                                        (2)

is solved by Newton's method with a logarithmic barrier; F is the information (inverse covariance), so μ counts in χ².
"""

from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray

_LAST_BARRIER = 1e-7
_FIRST_BARRIER = 1e3
_SHRINK = 0.1
_NEWTON_STEPS = 60
_DECREMENT = 1e-9
_ON_BOUNDARY = 1e-3
_AXES = "xyz"


@dataclass(frozen=True)
class Boundary:
    """Where a body touches the limit of what a rigid body can be.

    `normal` (3,): all mass lies in the plane normal to it, so the moments about the plane's axes add up to the one
    about `normal`. `thickness` is the least root of the second moment over the greatest; `massless` says that the mass
    is zero.
    """

    normal: FloatArray
    thickness: float
    massless: bool

    @property
    def words(self) -> str:
        """Return what is active, for a person."""
        if self.massless:
            return "mass at zero"
        direction = ", ".join(f"{axis} {value:+.2f}" for axis, value in zip(_AXES, self.normal, strict=True))
        return f"triangle inequality active: all mass in the plane normal to ({direction})"


def pseudo_inertia(vector: FloatArray) -> FloatArray:
    """Return P (..., 4, 4) of (1) of parameters (..., 10)."""
    matrix: FloatArray = np.einsum("...k,kij->...ij", vector, _BASIS)
    return matrix


def is_consistent(vector: FloatArray) -> bool:
    """Tell whether P of every body in (..., 10) is positive definite."""
    return bool((np.linalg.eigvalsh(pseudo_inertia(vector)) > 0.0).all())


def consistent(information: FloatArray, rhs: FloatArray, bodies: int) -> FloatArray:
    """Return the minimiser (p,) of (2) with every body consistent; the plain solution where that is consistent already.

    `information` (p, p) and `rhs` (p,) are F and b; the first 10 · `bodies` parameters are inertias, further ones are
    free. F must be positive definite where the barrier does not bound the bodies. Raises ValueError on other shapes.
    """
    inertial = 10 * bodies
    if information.shape != (len(rhs), len(rhs)) or len(rhs) < inertial:
        raise ValueError(f"information {information.shape} and right side {rhs.shape} do not hold {bodies} bodies")
    plain = _solved(information, rhs)
    if np.isfinite(plain).all() and is_consistent(plain[:inertial].reshape(bodies, 10)):
        return plain
    vector = np.zeros(len(rhs))
    masses = np.abs(np.nan_to_num(plain[:inertial:10])) + _START_KG
    vector[:inertial] = (masses[:, None] * _BALL).reshape(-1)
    barrier = _FIRST_BARRIER
    while barrier > _LAST_BARRIER:
        vector = _centred(vector, information, rhs, bodies, barrier)
        barrier *= _SHRINK
    return vector


def boundary(vector: FloatArray) -> Boundary | None:
    """Return what limit the body (10,) touches, if any: a thickness below a thousandth, or no mass."""
    mass_kg = float(vector[0])
    if mass_kg <= 0.0:
        return Boundary(np.full(3, np.nan), 0.0, massless=True)
    P = pseudo_inertia(vector)
    second_moment = P[:3, :3] - np.outer(P[:3, 3], P[:3, 3]) / mass_kg
    values, directions = np.linalg.eigh(second_moment)
    thickness = float(np.sqrt(max(values[0], 0.0) / max(values[2], np.finfo(float).tiny)))
    if thickness >= _ON_BOUNDARY:
        return None
    normal = directions[:, 0] * np.sign(directions[np.argmax(np.abs(directions[:, 0])), 0])
    return Boundary(normal, thickness, massless=False)


def _centred(vector: FloatArray, F: FloatArray, b: FloatArray, bodies: int, barrier: float) -> FloatArray:
    """Return the minimiser of (2) for one μ, from a `vector` inside."""
    inertial = 10 * bodies
    for _ in range(_NEWTON_STEPS):
        inverse = np.linalg.inv(pseudo_inertia(vector[:inertial].reshape(bodies, 10)))
        turned = np.einsum("bij,kjl->bkil", inverse, _BASIS)  # P⁻¹ E_k
        gradient = F @ vector - b
        gradient[:inertial] -= barrier * np.einsum("bkii->bk", turned).reshape(-1)
        curvature = F.copy()
        for body, block in enumerate(np.einsum("bkij,blji->bkl", turned, turned)):
            rows = slice(10 * body, 10 * body + 10)
            curvature[rows, rows] += barrier * block
        step = -_solved(curvature, gradient)
        decrement = float(-gradient @ step)
        length = _longest(vector, step, bodies) if decrement > barrier * 0.1 else 1.0
        vector = vector + length * step
        if decrement < _DECREMENT * barrier:
            break
    return vector


def _longest(vector: FloatArray, step: FloatArray, bodies: int) -> float:
    """Return a length of the step that stays well inside: at most 1, at most 0.7 of the way to the boundary."""
    P, dP = (pseudo_inertia(part[: 10 * bodies].reshape(bodies, 10)) for part in (vector, step))
    lower = np.linalg.inv(np.linalg.cholesky(P))
    outward = float(-np.linalg.eigvalsh(lower @ dP @ np.swapaxes(lower, 1, 2)).min())
    return min(1.0, 0.7 / outward) if outward > 0.0 else 1.0


def _solved(matrix: FloatArray, rhs: FloatArray) -> FloatArray:
    """Return the solution of a symmetric system, scaled to a unit diagonal; NaN if it is singular."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    try:
        solution: FloatArray = scale * np.linalg.solve(matrix * np.outer(scale, scale), scale * rhs)
    except np.linalg.LinAlgError:
        return np.full(len(rhs), np.nan)
    return solution


def _basis() -> FloatArray:
    """Return dP/dπ_k (10, 4, 4)."""
    basis = np.zeros((10, 4, 4))
    basis[0, 3, 3] = 1.0
    for axis in range(3):
        basis[1 + axis, axis, 3] = basis[1 + axis, 3, axis] = 1.0
        basis[4 + axis, :3, :3] = 0.5 * np.eye(3)
        basis[4 + axis, axis, axis] -= 1.0
    for k, (i, j) in enumerate(((1, 2), (0, 2), (0, 1))):
        basis[7 + k, i, j] = basis[7 + k, j, i] = -1.0
    return basis


_BASIS = _basis()
_START_KG = 1e-3
_BALL = np.array([1.0, 0.0, 0.0, 0.0, 0.02, 0.02, 0.02, 0.0, 0.0, 0.0])
"""A body of one kilogram and 0.1 m in radius of gyration: inside, wherever the search begins."""
