"""The rigid motion that moves points in space so as pictures show them: robust least squares, and where it begins.

A point at X in C(t₀), exposed at t₀, is seen again at t₁. Given how C moves within the step, R(t) and p(t) of
`inner_motion`, but for a constant rate δω and a constant velocity δv,

    X' = exp(−[δω]× t₁) R₁ᵀ (R₀ exp([δω]× t₀) X + p₀ − p₁ − δv (t₁ − t₀))                      (1)

Derivatives of the picture x = X'/Z', y = Y'/Z' by δω and δv: the equations of optical flow (Longuet-Higgins, Prazdny
1980). A point's disparity d is known no better than its place in a picture, to σ, and where the camera travels, it
shifts the point seen next by h = ∂(x, y)/∂d. So misfits r have the covariance

    σ² (1 + h hᵀ),   and d is best corrected by   hᵀ r / (1 + hᵀ h)                                            (2)

(without which far points and near ones, all moving much alike, tell a little too slow a travel). Least squares with
Tukey's weights finds the nearest minimum only, so it begins at the best of many motions that
two or three points each would have: the one that most points share.

What is foretold says where to look, and which of two motions is that of the ground: a trolley or the wearer's own leg
is a rigid body as well. It is no term of the least squares. And a motion shared by far more points than any motion
that was likely wins: then what was foretold is wrong.
"""

import math
from dataclasses import dataclass

import numpy as np

from messages.arrays import BoolArray, FloatArray
from perception import so3
from perception.motion.inner_motion import InnerMotion


@dataclass(frozen=True)
class RigidStep:
    """δω and δv of (1) (6,), their covariance (6, 6), how many points agree, and whether that was likely."""

    rates: FloatArray
    covariance: FloatArray
    inliers: int
    likely: bool


@dataclass(frozen=True)
class RigidStepSettings:
    """Noise in px of a picture with the focal length `f_px`."""

    f_px: float
    least_points: int = 12  # for six unknowns
    least_noise_px: float = 0.03  # of tracking, however still the picture
    most_noise_px: float = 0.5  # above it the points do not move as one rigid body
    agreeing_px: float = 1.0  # as far a point may be from a motion that it shares, before that is refined
    likely_sigmas: float = 3.0  # of what is foretold
    least_likely_radps: float = 0.02  # what nothing foretold is better than
    least_likely_mps: float = 0.06
    unforetold_radps: float = 0.06  # of a gyroscope whose bias is not known
    unforetold_mps: float = 1.5  # of a walker
    surprise: float = 3.0  # so many times as many points must share a motion that is not likely,
    majority: float = 0.6  # and this share of all, of which there must be
    least_surprising: int = 30  # so many
    enough: float = 0.7  # of the points share what is foretold: no other motion need be looked for
    rounds: int = 6  # of Gauss-Newton, at most
    settled_px: float = 0.02  # a round that moves the points no farther is the last


class PointsInStep:
    """N points at `points_C` (N, 3), of `disparity` (N,) in units of the focal length, exposed at `from_s` and seen
    again at `to_s` (N,), as `inner` has them move."""

    def __init__(
        self, points_C: FloatArray, disparity: FloatArray, from_s: FloatArray, to_s: FloatArray, inner: InnerMotion
    ) -> None:
        self._points_C, self._from_s, self._to_s = points_C, from_s[:, None], to_s
        self._disparity = disparity
        (R0, p0), (R1, p1) = inner.at(from_s), inner.at(to_s)
        self._R1T = R1.transpose(0, 2, 1)
        self._R10 = self._R1T @ R0
        self._shift = np.einsum("nij,nj->ni", self._R1T, p0 - p1)
        self._intervals_s = to_s - from_s

    def moved(self, rates: FloatArray) -> FloatArray:
        """Return X' (N, 3) of (1)."""
        turn, velocity = rates[:3], rates[3:]
        before = self._points_C - self._from_s * (self._points_C @ so3.skew(turn))
        after = np.einsum("nij,nj->ni", self._R10, before) + self._shift
        after -= self._intervals_s[:, None] * (self._R1T @ velocity)
        return _turned_back(after, turn, self._to_s)

    def shift(self, moved_C: FloatArray, rates: FloatArray) -> FloatArray:
        """Return h (N, 2) of (2), at X' = `moved_C`."""
        travel = self._shift - self._intervals_s[:, None] * (self._R1T @ rates[3:])
        across = travel[:, :2] - moved_C[:, :2] * (travel[:, 2:] / moved_C[:, 2:])
        shift: FloatArray = across / (moved_C[:, 2] * self._disparity)[:, None]
        return shift

    def relative(self, correction: FloatArray) -> FloatArray:
        """Return by what share a `correction` (N,) of its disparity brings each point nearer."""
        return correction / self._disparity

    def flow(self, moved_C: FloatArray) -> FloatArray:
        """Return ∂(x, y)/∂(δω, δv) of (1), (N, 2, 6), at X' = `moved_C`."""
        inverse = 1.0 / moved_C[:, 2]
        x, y = moved_C[:, 0] * inverse, moved_C[:, 1] * inverse
        flow = np.zeros((len(x), 2, 6))
        flow[:, 0, 0], flow[:, 0, 1], flow[:, 0, 2] = x * y, -1.0 - x * x, y
        flow[:, 1, 0], flow[:, 1, 1], flow[:, 1, 2] = 1.0 + y * y, -x * y, -x
        by_v = np.zeros((len(x), 2, 3))
        by_v[:, 0, 0] = by_v[:, 1, 1] = -inverse
        by_v[:, 0, 2], by_v[:, 1, 2] = x * inverse, y * inverse
        flow[:, :, 3:] = by_v @ self._R1T
        flow *= self._intervals_s[:, None, None]
        return flow


def solve(
    points: PointsInStep, seen: FloatArray, foretold: FloatArray | None, settings: RigidStepSettings
) -> RigidStep | None:
    """Return the motion by which `points` are at `seen` (N, 2), z = 1; None if too few of them share one.

    `foretold` is the covariance (6, 6) of δω and δv before anything is seen, None where nothing is known.
    """
    moved_C = points.moved(np.zeros(6))
    if moved_C[:, 2].min() < _LEAST_DEPTH_M:
        return None
    misfit = (seen - moved_C[:, :2] / moved_C[:, 2:]) * (settings.f_px / settings.agreeing_px)
    start = np.zeros(6)
    prior = np.linalg.inv(_likely(foretold, settings)).astype(np.float64)
    if _share(misfit) < settings.enough * len(misfit):
        flow = points.flow(moved_C) * (settings.f_px / settings.agreeing_px)
        start = _shared(misfit, flow, prior, settings)
    return _refined(points, seen, start, prior, settings)


def _likely(foretold: FloatArray | None, s: RigidStepSettings) -> FloatArray:
    """Return the covariance (6, 6) of motions that are likely."""
    if foretold is None:
        return np.diag(np.repeat((s.unforetold_radps**2, s.unforetold_mps**2), 3))
    return foretold + np.diag(np.repeat((s.least_likely_radps**2, s.least_likely_mps**2), 3))


def _share(misfit: FloatArray) -> FloatArray:
    """Return how many points (…) agree, those in between by their share; `misfit` is (N, 2, …), 1 as far as agrees."""
    share: FloatArray = np.maximum(1.0 - (misfit**2).sum(axis=1), 0.0).sum(axis=0)
    return share


def _is_likely(motion: FloatArray, prior: FloatArray, settings: RigidStepSettings) -> BoolArray:
    """Return for motions (…, 6) whether they are; `prior` is the inverse of their covariance."""
    square = np.einsum("...i,ij,...j", motion, prior, motion)
    likely: BoolArray = square < 6.0 * settings.likely_sigmas**2
    return likely


def _shared(misfit: FloatArray, flow: FloatArray, prior: FloatArray, settings: RigidStepSettings) -> FloatArray:
    """Return the motion (6,) that most points share, of what is foretold and of those that few points have each."""
    chance = np.random.default_rng(len(misfit))
    motions = [np.zeros((1, 6))]
    for count, part, tries in ((2, slice(3, 6), _PAIRS), (3, slice(0, 6), _TRIPLETS)):
        chosen = chance.integers(0, len(misfit), (tries, count))
        F, r = flow[chosen][..., part].reshape(tries, 2 * count, -1), misfit[chosen].reshape(tries, 2 * count, 1)
        FT = F.transpose(0, 2, 1)
        motion = np.zeros((tries, 6))
        motion[:, part] = np.linalg.solve(FT @ F + _RIDGE * prior[part, part], FT @ r)[..., 0]
        motions.append(motion)
    tried = np.concatenate(motions)
    share = _share(misfit[:, :, None] - flow @ tried.T)
    share[~_is_likely(tried, prior, settings)] /= settings.surprise
    best: FloatArray = tried[int(np.argmax(share))]
    return best


def _refined(
    points: PointsInStep, seen: FloatArray, rates: FloatArray, prior: FloatArray, settings: RigidStepSettings
) -> RigidStep | None:
    """Return the motion by Gauss-Newton on (1) with Tukey's weights, from `rates` on."""
    quiet, most = settings.least_noise_px / settings.f_px, settings.most_noise_px / settings.f_px
    agreeing, settled = settings.agreeing_px / settings.f_px, settings.settled_px / settings.f_px
    for _ in range(settings.rounds):
        moved_C = points.moved(rates)
        if moved_C[:, 2].min() < _LEAST_DEPTH_M:
            return None
        misfit, h = seen - moved_C[:, :2] / moved_C[:, 2:], points.shift(moved_C, rates)
        along, share = (h * misfit).sum(axis=1), 1.0 / (1.0 + (h**2).sum(axis=1))
        correction = share * along
        distance = np.sqrt((misfit**2).sum(axis=1) - along * correction)
        near = distance[distance < agreeing]
        if len(near) < settings.least_points:
            return None
        noise = max(quiet, float(np.partition(near, len(near) // 2)[len(near) // 2]) / _MEDIAN_OF_RAYLEIGH)
        weight = np.maximum(1.0 - (distance / (_TUKEY_SIGMAS * noise)) ** 2, 0.0) ** 2
        flow = points.flow(moved_C)
        flow[:, :, 3:] *= 1.0 + np.where(weight > 0.0, points.relative(correction), 0.0)[:, None, None]
        weighted = flow - (share[:, None] * h)[:, :, None] * (h[:, None] @ flow)
        weighted *= weight[:, None, None]
        F, WF = flow.reshape(-1, 6), weighted.reshape(-1, 6)
        try:
            inverse = np.linalg.inv(WF.T @ F)
        except np.linalg.LinAlgError:
            return None
        change = inverse @ (WF.T @ misfit.reshape(-1))
        rates = rates + change
        if float(np.abs(F @ change).max()) < settled:
            break
    inliers = int(np.count_nonzero(distance < _INLIER_SIGMAS * noise))
    likely = bool(_is_likely(rates, prior, settings))
    least = settings.least_points if likely else max(settings.least_surprising, settings.majority * len(misfit))
    if noise > most or inliers < least:
        return None
    return RigidStep(rates, noise**2 * inverse, inliers, likely)


def _turned_back(points: FloatArray, rate: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return exp(−[rate]× t) X for points (N, 3), each with its own t (N,)."""
    rate_radps = math.hypot(*rate)
    if rate_radps == 0.0:
        return points
    across = so3.skew(rate / rate_radps).T
    angles_rad = -rate_radps * times_s[:, None]
    once = points @ across
    turned: FloatArray = points + np.sin(angles_rad) * once + (1.0 - np.cos(angles_rad)) * (once @ across)
    return turned


_LEAST_DEPTH_M = 0.1
"""In front of the camera: a point nearer is no solution."""
_MEDIAN_OF_RAYLEIGH = 1.1774
"""Over the deviation of either coordinate."""
_TUKEY_SIGMAS = 4.685
"""From which on a point has no weight: 95 % efficiency with normal noise."""
_INLIER_SIGMAS = 3.0
"""Within which a point counts as agreeing: of normal noise, 99 % of the points."""
_PAIRS = 48
"""Of points, each of which tells a velocity: among half outliers, a dozen are sound."""
_TRIPLETS = 48
"""Of points, each of which tells a motion: among half outliers, six are sound."""
_RIDGE = 1e-3
"""Share of what is likely in a motion that two or three points do not tell."""
