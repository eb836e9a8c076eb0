"""Least squares of a stereo calibration: lenses, pair, the boards' places and the board's own shape, from corners.

A board's corner X in view v is seen by the left eye at π(X_Lv X; lens_L), by the right one at π(X_RL X_Lv X; lens_R),
with OpenCV's projection π. A printed board is not flat: its corners stand out of its plane by

    z = Σ a_jk (x̂ʲ ŷᵏ − …),   2 ≤ j + k ≤ 4,   x̂, ŷ from −1 to 1 over the board                            (1)

where that explains the corners better than a plane does: on a real board that was warped by a millimetre the residuals
fell by a third. What is subtracted keeps a term from moving or tilting the board. Corners count the less, the farther
they are off (Huber). The covariance is that of the normal equations times the residuals' variance, and larger where
neighbouring corners err alike: of a correlation ρ between neighbours either way, as of a process that is Markov along
both,

    n_effective = n ((1 − ρ) / (1 + ρ))²                                                                    (2)
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from messages.arrays import BoolArray, FloatArray, IntArray

LENS_TERMS = 9
"""fx, fy, cx, cy, k1, k2, p1, p2, k3 of one eye."""
_POWERS = tuple((degree - k, k) for degree in (2, 3, 4) for k in range(degree + 1))
SHAPE_TERMS = len(_POWERS)
"""Of (1)."""
_PAIR = slice(2 * LENS_TERMS, 2 * LENS_TERMS + 6)
_SHAPE = slice(_PAIR.stop, _PAIR.stop + SHAPE_TERMS)
COMMON = _SHAPE.stop
"""Parameters that all views share; six a view follow."""
K3, SHAPE = (8, LENS_TERMS + 8), _SHAPE
_HUBER_SIGMAS = 2.0
_MOST_STEPS, _DAMPING = 60, 1e-3


class SeenPair(NamedTuple):
    """One view: which corners (n,), and where the left and the right eye sees them, px (n, 2). `name` is for people."""

    name: str
    ids: IntArray
    left_px: FloatArray
    right_px: FloatArray


@dataclass(frozen=True)
class Bundle:
    """All parameters: of the lenses (9,) each, of the pair a rotation vector and a translation (6,), of the board's
    shape (12,), m, and of each view's board in L (v, 6)."""

    left: FloatArray
    right: FloatArray
    pair: FloatArray
    shape: FloatArray
    boards: FloatArray

    @property
    def vector(self) -> FloatArray:
        """Return all parameters in one vector (p,)."""
        return np.concatenate((self.left, self.right, self.pair, self.shape, self.boards.ravel()))

    @staticmethod
    def of(vector: FloatArray) -> "Bundle":
        """Return the parameters that a vector holds."""
        return Bundle(
            vector[:LENS_TERMS],
            vector[LENS_TERMS : 2 * LENS_TERMS],
            vector[_PAIR],
            vector[_SHAPE],
            vector[COMMON:].reshape(-1, 6),
        )


@dataclass(frozen=True)
class Solved:
    """The solution, its residuals per view, px (n, 4) as left x, y, right x, y, and the covariance (COMMON, COMMON) of
    what the views share; `free` (p,) tells what was fitted. `sigma_px` is the residuals' deviation, robustly;
    `neighbours` is ρ of (2)."""

    bundle: Bundle
    residuals_px: tuple[FloatArray, ...]
    covariance: FloatArray
    free: BoolArray
    sigma_px: float
    neighbours: float
    cost: float


def shape_basis(points: FloatArray) -> FloatArray:
    """Return (n, 12): the terms of (1) at the board's corners (n, 3), less the plane that is nearest to each."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    x, y = (2.0 * (points[:, :2] - low) / (high - low) - 1.0).T
    terms = np.stack([x**j * y**k for j, k in _POWERS], axis=-1)
    plane = np.stack((np.ones_like(x), x, y), axis=-1)
    basis: FloatArray = terms - plane @ np.linalg.lstsq(plane, terms, rcond=None)[0]
    return basis


def solve(views: list[SeenPair], points: FloatArray, start: Bundle, free: BoolArray) -> Solved:
    """Return the parameters that explain the views best, from `start`; only those that are `free` (p,) change.

    `points` (m, 3) are all corners of the flat board, m. Levenberg and Marquardt's steps, weights after Huber.
    """
    basis = shape_basis(points)
    now, damping = start, _DAMPING
    residual, J = _linearised(now, views, points, basis)
    scale = _robust_scale(residual)
    cost = _cost(residual, scale)
    chosen = np.flatnonzero(free)
    for _ in range(_MOST_STEPS):
        weights = _weights(residual, scale)
        Jw = J[:, chosen] * weights[:, None]
        normal, gradient = Jw.T @ J[:, chosen], Jw.T @ residual
        size = np.sqrt(np.diag(normal)) + 1e-300
        scaled = normal / np.outer(size, size)
        step = np.zeros(len(free))
        step[chosen] = np.linalg.solve(scaled + damping * np.eye(len(chosen)), -gradient / size) / size
        tried = Bundle.of(now.vector + step)
        residual_tried, J_tried = _linearised(tried, views, points, basis)
        cost_tried = _cost(residual_tried, scale)
        if cost_tried < cost:
            gained = (cost - cost_tried) / cost
            now, residual, J = tried, residual_tried, J_tried
            scale = _robust_scale(residual)
            cost, damping = _cost(residual, scale), max(1e-9, 0.1 * damping)
            if gained < 1e-8:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return _solved(now, views, residual, J, free, points)


def _solved(
    bundle: Bundle, views: list[SeenPair], residual: FloatArray, J: FloatArray, free: BoolArray, points: FloatArray
) -> Solved:
    chosen = np.flatnonzero(free)
    scale = _robust_scale(residual)
    weights = _weights(residual, scale)
    Jw = J[:, chosen] * np.sqrt(weights)[:, None]
    size = np.linalg.norm(Jw, axis=0) + 1e-300
    inverse = np.linalg.pinv((Jw / size).T @ (Jw / size), hermitian=True) / np.outer(size, size)
    variance = float(weights @ residual**2) / max(1, len(residual) - len(chosen))
    parts, at = list[FloatArray](), 0
    for view in views:
        parts.append(residual[at : at + 4 * len(view.ids)].reshape(-1, 4))
        at += 4 * len(view.ids)
    rho = _neighbours_alike(views, parts, points, variance)
    covariance = np.zeros((COMMON, COMMON))
    common = chosen[chosen < COMMON]
    covariance[np.ix_(common, common)] = inverse[: len(common), : len(common)]
    covariance *= variance * ((1.0 + rho) / (1.0 - rho)) ** 2
    return Solved(bundle, tuple(parts), covariance, free, variance**0.5, rho, float(weights @ residual**2))


def _neighbours_alike(views: list[SeenPair], parts: list[FloatArray], points: FloatArray, variance: float) -> float:
    """Return ρ of (2) between corners that are next to each other on the board, 0 where that is no more than chance."""
    side = np.linalg.norm(points[1] - points[0])
    products = list[FloatArray]()
    for view, residual in zip(views, parts, strict=True):
        places = points[view.ids]
        apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
        first, second = np.nonzero(np.triu(apart < 1.2 * side, k=1))
        products.append((residual[first] * residual[second]).ravel())
    together = np.clip(np.concatenate(products) / variance, -9.0, 9.0)
    rho = float(together.mean())
    return min(0.9, rho) if rho > 3.0 / len(together) ** 0.5 else 0.0


def _linearised(
    bundle: Bundle, views: list[SeenPair], points: FloatArray, basis: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (r,), projected minus seen, and their derivatives (r, p)."""
    bent = points.copy()
    bent[:, 2] += basis @ bundle.shape
    residuals, rows = list[FloatArray](), list[FloatArray]()
    R_RL, dR_pair = _rotation(bundle.pair[:3])
    for number, (view, board) in enumerate(zip(views, bundle.boards, strict=True)):
        X, terms = bent[view.ids], basis[view.ids]
        R, dR = _rotation(board[:3])
        in_left = X @ R.T + board[3:]
        in_right = in_left @ R_RL.T + bundle.pair[3:]
        block = np.zeros((len(X), 4, COMMON + bundle.boards.size))
        place = slice(COMMON + 6 * number, COMMON + 6 * number + 6)
        d_left = np.concatenate((np.einsum("kij,nj->nik", dR, X), np.broadcast_to(np.eye(3), (len(X), 3, 3))), axis=2)
        d_shape = R[:, 2][None, :, None] * terms[:, None, :]
        seen = np.concatenate((view.left_px, view.right_px), axis=1)
        told = np.empty_like(seen)
        told[:, :2], by_point, by_lens = _projected(in_left, bundle.left)
        block[:, :2, :LENS_TERMS] = by_lens
        block[:, :2, place] = by_point @ d_left
        block[:, :2, _SHAPE] = by_point @ d_shape
        told[:, 2:], by_point, by_lens = _projected(in_right, bundle.right)
        block[:, 2:, LENS_TERMS : 2 * LENS_TERMS] = by_lens
        turned = by_point @ R_RL
        block[:, 2:, place] = turned @ d_left
        block[:, 2:, _SHAPE] = turned @ d_shape
        d_pair = np.concatenate(
            (np.einsum("kij,nj->nik", dR_pair, in_left), np.broadcast_to(np.eye(3), (len(X), 3, 3))), axis=2
        )
        block[:, 2:, _PAIR] = by_point @ d_pair
        residuals.append((told - seen).ravel())
        rows.append(block.reshape(4 * len(X), -1))
    return np.concatenate(residuals), np.concatenate(rows)


def _rotation(rotvec: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation (3, 3) and its derivatives (3, 3, 3) by each part of the rotation vector."""
    R, by_vector = cv2.Rodrigues(rotvec.astype(np.float64))
    return np.asarray(R, dtype=np.float64), np.asarray(by_vector, dtype=np.float64).reshape(3, 3, 3)


def _projected(points: FloatArray, lens: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pixels (n, 2) of points in the camera (n, 3), their derivatives by the point (n, 2, 3) and by the lens
    (n, 2, 9): fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    K = np.array(((lens[0], 0.0, lens[2]), (0.0, lens[1], lens[3]), (0.0, 0.0, 1.0)))
    px, J = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, lens[4:])
    J = np.asarray(J, dtype=np.float64).reshape(len(points), 2, -1)
    return np.asarray(px[:, 0], dtype=np.float64), J[:, :, 3:6], J[:, :, 6:15]


def _robust_scale(residual: FloatArray) -> float:
    return max(1e-9, 1.4826 * float(np.median(np.abs(residual))))


def _weights(residual: FloatArray, scale: float) -> FloatArray:
    return np.minimum(1.0, _HUBER_SIGMAS * scale / np.maximum(np.abs(residual), 1e-300))


def _cost(residual: FloatArray, scale: float) -> float:
    size = np.abs(residual) / scale
    k = _HUBER_SIGMAS
    return scale**2 * float(np.where(size < k, 0.5 * size**2, k * (size - 0.5 * k)).sum())
