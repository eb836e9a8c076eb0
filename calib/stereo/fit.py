"""A stereo calibration from views of a board: OpenCV's estimate to begin with, the bundle, and what it is worth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.stereo.board import Board
from calib.stereo.bundle import K3, LENS_TERMS, SHAPE, Bundle, SeenPair, Solved, shape_basis, solve
from calib.stereo.consequences import Consequences, consequences
from messages import Lens, Pose, Residual, StereoCalibration, UserError, matrix3, vec3
from messages.arrays import FloatArray
from messages.constants import NORMAL_95

LEAST_VIEWS = 5
_WHOLE_FIT_VIEWS = 8
"""From so many views on the board's shape and a third radial term are tried."""
_FAR_SIGMAS = 6.0
"""A corner beyond is another one, or none; one in a thousand of a blurred edge's is."""
_MOST_CORNERS_OUT = 0.15
_BAD_VIEW = 2.5
"""A view whose residuals' median is so many times the usual one has moved, is blurred, or its eyes are of two times."""
_WORTH = 10.0
"""By which a model's −2 log likelihood must fall for each further parameter: errors of corners are not independent."""
_MOST_FOCAL_STD = 0.01


class Quantity(NamedTuple):
    """A value with its 95 % interval and its unit."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class StereoFit:
    """The pair, what remains of its errors, and how it was found.

    `views` took part, `left_out` names views and why; `corners_out` single corners. `flat` tells whether the board was
    taken for flat, `bulge_m` by how much it stands out of its plane at most. `rms_px` is the root mean square distance
    of corners from where they are projected, over both eyes, as OpenCV's stereoCalibrate states it.
    """

    stereo: StereoCalibration
    residual: Residual
    views: tuple[SeenPair, ...]
    left_out: tuple[tuple[str, str], ...]
    corners_out: int
    rms_px: float
    eye_rms_px: tuple[float, float]
    bulge_m: float
    flat: bool
    worth: Consequences
    quantities: dict[str, Quantity]
    residuals_px: tuple[FloatArray, ...]
    square_m: float

    def scaled_to(self, baseline_m: float) -> "StereoFit":
        """Return the fit with a baseline that is known instead of the board's squares."""
        by = baseline_m / float(np.linalg.norm(self.stereo.X_RL.p_m))
        X_RL = msgspec.structs.replace(self.stereo.X_RL, p_m=vec3(by * np.array(self.stereo.X_RL.p_m)))
        quantities = {
            name: Quantity(by * q.value, by * q.low, by * q.high, q.unit) if q.unit == "m" else q
            for name, q in self.quantities.items()
        }
        return replace(
            self,
            stereo=msgspec.structs.replace(self.stereo, X_RL=X_RL),
            bulge_m=by * self.bulge_m,
            quantities=quantities,
            square_m=by * self.square_m,
        )


def fit_pair(
    views: Sequence[SeenPair], board: Board, size_px: tuple[int, int], where: str, *, board_error: float = 1e-3
) -> StereoFit:
    """Return the calibration of a pair from views of one board in pictures of `size_px`.

    `board_error` is one standard deviation of the squares' relative error, all alike. Raises UserError, its line
    beginning with `where`, where the views do not tell the lenses.
    """
    if len(views) < LEAST_VIEWS:
        raise UserError(
            f"{where}: both eyes see the board in {len(views)} pairs, allowed from {LEAST_VIEWS}: hold it at different "
            "distances and tilted by 30° and more toward each side, all of it in both pictures"
        )
    used, left_out, corners_out = list(views), list[tuple[str, str]](), 0
    solved = _fitted(used, board, size_px, where)
    for _ in range(4):
        kept, further, corners = _sorted_out(used, solved)
        if not further and not corners:
            break
        left_out, corners_out = left_out + further, corners_out + corners
        used = kept
        if len(used) < LEAST_VIEWS:
            raise UserError(
                f"{where}: {len(used)} of {len(views)} pairs are left, allowed from {LEAST_VIEWS}; the others' corners "
                "do not fit: did the board move, or are the eyes not exposed together?"
            )
        solved = _fitted(used, board, size_px, where)
    return _result(used, left_out, corners_out, solved, board, size_px, where, board_error)


def _fitted(views: list[SeenPair], board: Board, size_px: tuple[int, int], where: str) -> Solved:
    """Return the best of the models that the views can tell: k3 or none, the board flat or not."""
    points, start = board.points, _start(views, board, size_px, where)
    free = np.ones(len(start.vector), dtype=np.bool_)
    free[list(K3)], free[SHAPE] = False, False
    best = solve(views, points, start, free)
    if len(views) < _WHOLE_FIT_VIEWS:
        return best
    bent, cubic = free.copy(), list(K3)
    bent[SHAPE] = True
    for wider in (bent, None):
        tried = best.free.copy() if wider is None else wider
        if wider is None:
            tried[cubic] = True
        candidate = solve(views, points, best.bundle, tried)
        corners = sum(part.size for part in candidate.residuals_px)
        gain = corners * math.log(best.cost / candidate.cost)
        if gain > _WORTH * (tried.sum() - best.free.sum()):
            best = candidate
    return best


def _start(views: list[SeenPair], board: Board, size_px: tuple[int, int], where: str) -> Bundle:
    """Return OpenCV's calibration of each eye and of the pair."""
    points = board.points.astype(np.float32)
    on_board = [points[view.ids] for view in views]
    left, right = ([px.astype(np.float32) for px in eye] for eye in zip(*(v[2:] for v in views), strict=True))
    flags = cv2.CALIB_FIX_K3
    try:
        _, K_L, D_L, rotations, places = cv2.calibrateCamera(on_board, left, size_px, None, None, flags=flags)
        _, K_R, D_R, _, _ = cv2.calibrateCamera(on_board, right, size_px, None, None, flags=flags)
        *_, R, T, _, _ = cv2.stereoCalibrate(
            on_board, left, right, K_L, D_L, K_R, D_R, size_px, flags=cv2.CALIB_FIX_INTRINSIC
        )
    except cv2.error as error:
        raise UserError(f"{where}: the views of the board tell no lens: {error.err or 'no solution'}") from error

    def lens(K: NDArray[Any], D: NDArray[Any]) -> FloatArray:
        return np.array((K[0, 0], K[1, 1], K[0, 2], K[1, 2], *D.ravel()[:5]))

    boards = np.array([(*r.ravel(), *t.ravel()) for r, t in zip(rotations, places, strict=True)])
    pair = np.concatenate((Rotation.from_matrix(R).as_rotvec(), np.asarray(T, dtype=np.float64).ravel()))
    return Bundle(lens(K_L, D_L), lens(K_R, D_R), pair, np.zeros(SHAPE.stop - SHAPE.start), boards)


def _sorted_out(views: list[SeenPair], solved: Solved) -> tuple[list[SeenPair], list[tuple[str, str]], int]:
    """Return the views less what does not fit, which were left out and why, and how many single corners."""
    medians = np.array([float(np.median(np.abs(part))) for part in solved.residuals_px])
    usual = float(np.median(medians))
    kept, out, corners = list[SeenPair](), list[tuple[str, str]](), 0
    for view, residual, median in zip(views, solved.residuals_px, medians, strict=True):
        far = (np.abs(residual) > _FAR_SIGMAS * 1.4826 * max(usual, median)).any(axis=1)
        if median > _BAD_VIEW * usual:
            out.append((view.name, f"corners are off by {median / usual:.1f} times the usual"))
        elif far.mean() > _MOST_CORNERS_OUT:
            out.append((view.name, f"{far.sum()} of {len(far)} corners do not fit"))
        else:
            corners += int(far.sum())
            good = ~far
            kept.append(SeenPair(view.name, view.ids[good], view.left_px[good], view.right_px[good]))
    return kept, out, corners


def _result(
    views: list[SeenPair],
    left_out: list[tuple[str, str]],
    corners_out: int,
    solved: Solved,
    board: Board,
    size_px: tuple[int, int],
    where: str,
    board_error: float,
) -> StereoFit:
    bundle, std = solved.bundle, np.sqrt(np.diag(solved.covariance))
    for eye, lens, error in (("left", bundle.left, std[0]), ("right", bundle.right, std[LENS_TERMS])):
        if not error < _MOST_FOCAL_STD * lens[0]:
            raise UserError(
                f"{where}: the {eye} eye's focal length is {lens[0]:.0f} ± {error:.0f} px (1 σ), allowed "
                f"{100 * _MOST_FOCAL_STD:g} %: the views do not tell it; tilt the board by 30° toward each side"
            )
    stereo = StereoCalibration(
        left=_lens(bundle.left, size_px),
        right=_lens(bundle.right, size_px),
        X_RL=Pose(R=matrix3(Rotation.from_rotvec(bundle.pair[:3]).as_matrix()), p_m=vec3(bundle.pair[3:])),
    )
    worth = consequences(stereo, bundle, solved.covariance, views, board_error)
    bulge = shape_basis(board.points) @ bundle.shape
    flat = not solved.free[SHAPE].any()
    residual = Residual(
        toe_in_rad=worth.toe_in_rad,
        rows_rad=worth.rows_rad,
        focal_length=float(max(std[0] / bundle.left[0], std[LENS_TERMS] / bundle.right[0])),
        baseline=worth.baseline,
    )
    every = np.concatenate(solved.residuals_px)
    squares = every**2
    eye_rms = (math.sqrt(squares[:, :2].sum(axis=1).mean()), math.sqrt(squares[:, 2:].sum(axis=1).mean()))
    return StereoFit(
        stereo=stereo,
        residual=residual,
        views=tuple(views),
        left_out=tuple(left_out),
        corners_out=corners_out,
        rms_px=math.sqrt(squares.sum() / (2 * len(every))),
        eye_rms_px=eye_rms,
        bulge_m=float(np.ptp(bulge)),
        flat=flat,
        worth=worth,
        quantities=_quantities(bundle, std, worth),
        residuals_px=solved.residuals_px,
        square_m=board.square_m,
    )


def _lens(terms: FloatArray, size_px: tuple[int, int]) -> Lens:
    fx, fy, cx, cy, *distortion = terms.tolist()
    return Lens(
        width_px=size_px[0],
        height_px=size_px[1],
        fx_px=fx,
        fy_px=fy,
        cx_px=cx,
        cy_px=cy,
        distortion=tuple(distortion),
    )


_LENS_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def _quantities(bundle: Bundle, std: FloatArray, worth: Consequences) -> dict[str, Quantity]:
    """Return all values with their 95 % intervals, those that were not fitted left out."""
    found = dict[str, Quantity]()

    def add(name: str, value: float, error: float, unit: str) -> None:
        if error > 0.0:
            found[name] = Quantity(value, value - NORMAL_95 * error, value + NORMAL_95 * error, unit)

    for eye, at, lens in (("left", 0, bundle.left), ("right", LENS_TERMS, bundle.right)):
        for k, name in enumerate(_LENS_NAMES):
            add(f"{eye}.{name}{'_px' if k < 4 else ''}", float(lens[k]), float(std[at + k]), "px" if k < 4 else "1")
    for k, name in enumerate(("rx_rad", "ry_rad", "rz_rad", "tx_m", "ty_m", "tz_m")):
        unit = "rad" if k < 3 else "m"
        error = float(std[2 * LENS_TERMS + k])
        value = float(bundle.pair[k])
        add(f"pair.{name}", value, math.hypot(error, worth.board_error * value) if k >= 3 else error, unit)
    baseline_m = float(np.linalg.norm(bundle.pair[3:]))
    add("baseline_m", baseline_m, worth.baseline * baseline_m, "m")
    add("depth_scale", 1.0, worth.depth_scale, "1")
    return found


def with_pair(known: Residual, fitted: Residual) -> Residual:
    """Return `known` with what the fit of the pair tells in its place."""
    return msgspec.structs.replace(
        known,
        toe_in_rad=fitted.toe_in_rad,
        rows_rad=fitted.rows_rad,
        focal_length=fitted.focal_length,
        baseline=fitted.baseline,
    )
