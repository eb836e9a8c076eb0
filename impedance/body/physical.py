"""Physically consistent inertias: the body of positive mass that lies nearest in the metric of the information.

A rigid body's pseudo-inertia (Wensing, Kim and Slotine 2018)

    P(π) = [[Σ, h], [hᵀ, m]] ⪰ 0,   Σ = ½ tr(J) 1 − J,   h = m d                                                 (1)

is linear in its ten parameters π = (m, h, J_xx, J_yy, J_zz, J_yz, J_xz, J_xy), J the tensor about the origin. P ⪰ 0
says that the mass is positive and that the moments satisfy the triangle inequality. Where the best fit breaks (1),

    min ½ πᵀ F π − bᵀ π − μ Σ_bodies log det P(π),   μ → 0                                                        (2)

is solved by Newton's method with a logarithmic barrier; F is the information (inverse covariance), so μ counts in χ².
Steps are taken in P + dP = L (1 + Δ) Lᵀ, P = L Lᵀ (3), where the barrier's curvature is μ 1 however thin a body is; μ
begins where it outweighs the slope of the fit, or a body would collapse before it has turned.
"""

from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray

_LAST_BARRIER = 1e-7
_SHRINK = 0.1
_NEWTON_STEPS = 60
_DECREMENT = 1e-9
_ROUNDING = 16.0 * np.finfo(float).eps
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
    barrier = float(np.linalg.norm(_scaling(vector, bodies).T @ (information @ vector - rhs)))
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
    """Return the minimiser of (2) for one μ, from a `vector` inside; the last one where rounding ends the way."""
    inertial = 10 * bodies
    for _ in range(_NEWTON_STEPS):
        T = _scaling(vector, bodies)
        gradient = T.T @ (F @ vector - b)
        gradient[:inertial] -= barrier * np.tile(_TRACES, bodies)
        curvature = T.T @ F @ T
        curvature[:inertial, :inertial] += barrier * np.eye(inertial)
        step = -_solved(curvature, gradient)
        moved = vector + _length(step[:inertial].reshape(bodies, 10)) * (T @ step)
        if not (np.isfinite(moved).all() and _is_inside(moved, bodies)):
            break
        vector = moved
        if -gradient @ step < _DECREMENT * barrier:
            break
    return vector


def _scaling(vector: FloatArray, bodies: int) -> FloatArray:
    """Return T (p, p) of dπ = T δ: of every body δ are the parts of Δ along `_SYMMETRIC`, P + dP = L (1 + Δ) Lᵀ (3)."""
    T = np.eye(len(vector))
    for body in range(bodies):
        rows = slice(10 * body, 10 * body + 10)
        L = np.linalg.cholesky(pseudo_inertia(vector[rows]))
        T[rows, rows] = _parameters(L @ _SYMMETRIC @ L.T).T
    return T


def _length(step: FloatArray) -> float:
    """Return the share of the step (b, 10) to go: all of it while it is short, at most 0.7 of the way to the edge."""
    outward = float(-np.linalg.eigvalsh(np.einsum("bk,kij->bij", np.nan_to_num(step), _SYMMETRIC)).min())
    return min(1.0, 0.7 / outward) if outward > 0.0 else 1.0


def _is_inside(vector: FloatArray, bodies: int) -> bool:
    """Tell whether P of every body is positive definite by more than rounding can pretend."""
    values = np.linalg.eigvalsh(pseudo_inertia(vector[: 10 * bodies].reshape(bodies, 10)))
    return bool((values[:, 0] > _ROUNDING * values[:, -1]).all())


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


def _parameters(matrix: FloatArray) -> FloatArray:
    """Return π (..., 10) of P (..., 4, 4), the inverse of `pseudo_inertia`."""
    second = matrix[..., :3, :3]
    J = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    moments = [J[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    vector: FloatArray = np.stack([matrix[..., 3, 3], *np.moveaxis(matrix[..., :3, 3], -1, 0), *moments], axis=-1)
    return vector


def _symmetric() -> FloatArray:
    """Return an orthonormal basis (10, 4, 4) of the symmetric matrices."""
    basis = []
    for i, j in zip(*np.triu_indices(4), strict=True):
        unit = np.zeros((4, 4))
        unit[i, j] = unit[j, i] = 1.0
        basis.append(unit / np.linalg.norm(unit))
    return np.array(basis)


_SYMMETRIC = _symmetric()
_TRACES: FloatArray = np.trace(_SYMMETRIC, axis1=1, axis2=2)
_BASIS = _basis()
_START_KG = 1e-3
_BALL = np.array([1.0, 0.0, 0.0, 0.0, 0.02, 0.02, 0.02, 0.0, 0.0, 0.0])
"""A body of one kilogram and 0.1 m in radius of gyration: inside, wherever the search begins."""
