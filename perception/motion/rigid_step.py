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
is a rigid body as well. It is no term of the least squares. Where the motion that was found is another than foretold,
and many points share a motion near that more sharply, it is this one: a rollator that sets off with its wearer moves
by less than `agreeing_px` otherwise than the ground, and what fits both is neither's motion. And a motion shared by far
more points than any motion that was likely wins: then what was foretold is wrong.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from messages.arrays import BoolArray, FloatArray
from perception import so3
from perception.motion.bent_distances import Bend
from perception.motion.inner_motion import InnerMotion
from perception.motion.mirrored import Disagreement, disagreement


@dataclass(frozen=True)
class RigidStep:
    """δω and δv of (1) (6,), their covariance (6, 6), which points (N,) agree, which of those near do not, the noise
    of those that do (of a tangent), whether that was likely, and the bend of the distances."""

    rates: FloatArray
    covariance: FloatArray
    agrees: BoolArray
    disagreeing: Disagreement
    noise: float
    likely: bool
    bend: Bend

    @property
    def inliers(self) -> int:
        """Return how many points agree."""
        return int(np.count_nonzero(self.agrees))


@dataclass(frozen=True)
class RigidStepSettings:
    """Noise in px of a picture with the focal length `f_px`."""

    f_px: float
    least_points: int = 12  # for six unknowns
    least_noise_px: float = 0.03  # of tracking, however still the picture
    most_noise_px: float = 0.5  # above it the points do not move as one rigid body
    sharp_px: float = 0.25  # the same, of a motion beside another body's that is nearly the same,
    sharp_share: float = 0.4  # which so many of the points must share
    agreeing_px: float = 1.0  # as far a point may be from a motion that it shares, before that is refined
    near_px: float = 2.0  # and as far one that is no other body's
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
    again at `to_s` (N,), as `inner` has them move.

    Within this module coordinates come first, (3, N): numpy then runs along the points.
    """

    def __init__(
        self, points_C: FloatArray, disparity: FloatArray, from_s: FloatArray, to_s: FloatArray, inner: InnerMotion
    ) -> None:
        count = len(points_C)
        R, p_m = inner.at(np.concatenate((from_s, to_s)))
        R0, R1T = R[:count], R[count:].transpose(0, 2, 1)
        travel = p_m[:count] - p_m[count:]
        # R₁ᵀ times [ R₀ (−t₀ [X]×) | −(t₁ − t₀) | R₀ X + p₀ − p₁ | p₀ − p₁ ]
        inside = np.zeros((count, 3, 8))
        inside[:, :, :3] = R0 @ _across(points_C * -from_s[:, None])
        inside[:, 0, 3] = inside[:, 1, 4] = inside[:, 2, 5] = from_s - to_s
        inside[:, :, 6] = (R0 @ points_C[:, :, None])[:, :, 0] + travel
        inside[:, :, 7] = travel
        seen = np.ascontiguousarray((R1T @ inside).transpose(2, 1, 0))
        self._by_rates, self._steady, self._travel = seen[:6], seen[6], seen[7]
        self._intervals_s, self._middle_s, self._to_s = to_s - from_s, 0.5 * (from_s + to_s), to_s
        self._disparity, self._acceleration_sd = disparity, inner.acceleration_sd
        self.places: FloatArray = (points_C[:, :2] / points_C[:, 2:]).T

    def moved(self, rates: FloatArray) -> FloatArray:
        """Return X' (3, N) of (1)."""
        after = self._steady + (rates @ self._by_rates.reshape(6, -1)).reshape(3, -1)
        return _turned_back(after, rates[:3], self._to_s)

    def off(self, rates: FloatArray, seen: FloatArray) -> FloatArray:
        """Return how far (N,), tangents, the points are from where they are `seen` (N, 2) after a motion."""
        moved = self.moved(rates)
        off: FloatArray = np.hypot(*(seen.T - moved[:2] / np.maximum(moved[2], _LEAST_DEPTH_M)))
        return off

    def shift(self, picture: FloatArray, depth: FloatArray, rates: FloatArray) -> FloatArray:
        """Return h (2, N) of (2), at X' that `picture` (2, N) shows at `depth` (N,)."""
        travel = self._travel + (rates[3:] @ self._by_rates[3:].reshape(3, -1)).reshape(3, -1)
        shift: FloatArray = (travel[:2] - picture * travel[2]) / (depth * self._disparity)
        return shift

    def relative(self, correction: FloatArray) -> FloatArray:
        """Return by what share a `correction` (N,) of its disparity brings each point nearer."""
        return correction / self._disparity

    def flow(self, picture: FloatArray, depth: FloatArray) -> FloatArray:
        """Return ∂(x, y)/∂(δω, δv) of (1), (6, 2, N), at X' that `picture` (2, N) shows at `depth` (N,)."""
        x, y = picture
        dt = self._intervals_s
        x_dt, y_dt = x * dt, y * dt
        flow = np.empty((6, 2, len(depth)))
        flow[0, 0], flow[1, 0], flow[2, 0] = x * y_dt, -dt - x * x_dt, y_dt
        flow[0, 1], flow[1, 1], flow[2, 1] = dt + y * y_dt, -flow[0, 0], -x_dt
        by_v = self._by_rates[3:]
        flow[3:] = (by_v[:, :2] - picture * by_v[:, 2:]) / depth
        return flow

    def with_accelerations(self, flow: FloatArray) -> FloatArray:
        """Return `flow` (6, 2, N), and where `inner` leaves accelerations unknown, the derivatives by these below it
        (12, 2, N): rates that grow by a move a point as constant ones of a (t₀ + t₁) / 2 do."""
        return flow if self._acceleration_sd is None else np.concatenate((flow, self._middle_s * flow))

    @property
    def acceleration_sd(self) -> FloatArray:
        """Return the deviations (6,) of these accelerations, or (0,) where they are known."""
        return np.zeros(0) if self._acceleration_sd is None else self._acceleration_sd


def solve(
    points: PointsInStep, seen: FloatArray, foretold: FloatArray | None, settings: RigidStepSettings
) -> RigidStep | None:
    """Return the motion by which `points` are at `seen` (N, 2), z = 1; None if too few of them share one.

    `foretold` is the covariance (6, 6) of δω and δv before anything is seen, None where nothing is known.
    """
    moved_C = points.moved(np.zeros(6))
    if moved_C[2].min() < _LEAST_DEPTH_M:
        return None
    seen = np.ascontiguousarray(seen.T)
    prior = np.linalg.inv(_likely(foretold, settings)).astype(np.float64)
    picture = moved_C[:2] / moved_C[2]
    misfit = (seen - picture) * (settings.f_px / settings.agreeing_px)
    start = np.zeros(6)
    if _share(misfit) < settings.enough * misfit.shape[1]:
        flow = points.flow(picture, moved_C[2]) * (settings.f_px / settings.agreeing_px)
        start = _shared(misfit, flow, prior, settings)
    step = _refined(points, seen, start, prior, settings)
    if step is None or foretold is None or _square(step, foretold) < 6.0 * settings.likely_sigmas**2:
        return step
    near = _refined(points, seen, np.zeros(6), prior, replace(settings, agreeing_px=settings.sharp_px))
    if near is None or not near.likely or near.inliers < settings.sharp_share * seen.shape[1]:
        return step
    return near


def _square(step: RigidStep, foretold: FloatArray) -> float:
    """Return χ² of six of what a step differs from what was foretold, with the covariances of both."""
    return float(step.rates @ np.linalg.solve(step.covariance + foretold, step.rates))


def _likely(foretold: FloatArray | None, s: RigidStepSettings) -> FloatArray:
    """Return the covariance (6, 6) of motions that are likely."""
    if foretold is None:
        return np.diag([s.unforetold_radps**2] * 3 + [s.unforetold_mps**2] * 3)
    return foretold + np.diag([s.least_likely_radps**2] * 3 + [s.least_likely_mps**2] * 3)


def _share(misfit: FloatArray) -> FloatArray:
    """Return how many points (…) agree, those in between by their share; `misfit` is (…, 2, N), 1 as far as agrees."""
    share: FloatArray = np.maximum(1.0 - (misfit * misfit).sum(axis=-2), 0.0).sum(axis=-1)
    return share


def _is_likely(motion: FloatArray, prior: FloatArray, settings: RigidStepSettings) -> BoolArray:
    """Return for motions (…, 6) whether they are; `prior` is the inverse of their covariance."""
    square = ((motion @ prior) * motion).sum(axis=-1)
    likely: BoolArray = square < 6.0 * settings.likely_sigmas**2
    return likely


def _shared(misfit: FloatArray, flow: FloatArray, prior: FloatArray, settings: RigidStepSettings) -> FloatArray:
    """Return the motion (6,) that most points share, of what is foretold and of those that few points have each."""
    points = misfit.shape[1]
    chance = np.random.default_rng(points)
    motions = [np.zeros((1, 6))]
    for count, part, tries in ((2, slice(3, 6), _PAIRS), (3, slice(0, 6), _TRIPLETS)):
        chosen = chance.integers(0, points, (tries, count))
        FT = flow[part][:, :, chosen].transpose(2, 0, 1, 3).reshape(tries, -1, 2 * count)
        r = misfit[:, chosen].transpose(1, 0, 2).reshape(tries, 2 * count, 1)
        motion = np.zeros((tries, 6))
        motion[:, part] = np.linalg.solve(FT @ FT.transpose(0, 2, 1) + _RIDGE * prior[part, part], FT @ r)[..., 0]
        motions.append(motion)
    tried = np.concatenate(motions)
    share = _share(misfit - (tried @ flow.reshape(6, -1)).reshape(-1, 2, points))
    share[~_is_likely(tried, prior, settings)] /= settings.surprise
    best: FloatArray = tried[int(np.argmax(share))]
    return best


def _refined(
    points: PointsInStep, seen: FloatArray, rates: FloatArray, prior: FloatArray, settings: RigidStepSettings
) -> RigidStep | None:
    """Return the motion by Gauss-Newton on (1) with Tukey's weights, from `rates` on; `seen` is (2, N)."""
    quiet, most = settings.least_noise_px / settings.f_px, settings.most_noise_px / settings.f_px
    agreeing, settled = settings.agreeing_px / settings.f_px, settings.settled_px / settings.f_px
    for _ in range(settings.rounds):
        moved_C = points.moved(rates)
        depth = moved_C[2]
        if depth.min() < _LEAST_DEPTH_M:
            return None
        picture = moved_C[:2] / depth
        misfit, h = seen - picture, points.shift(picture, depth, rates)
        along, share = (h * misfit).sum(axis=0), 1.0 / (1.0 + (h * h).sum(axis=0))
        correction = share * along
        distance = np.sqrt((misfit * misfit).sum(axis=0) - along * correction)
        near = distance[distance < agreeing]
        if len(near) < settings.least_points:
            return None
        noise = max(quiet, float(np.partition(near, len(near) // 2)[len(near) // 2]) / _MEDIAN_OF_RAYLEIGH)
        weight = np.maximum(1.0 - (distance / (_TUKEY_SIGMAS * noise)) ** 2, 0.0) ** 2
        flow = points.flow(picture, depth)
        flow[3:] *= 1.0 + np.where(weight > 0.0, points.relative(correction), 0.0)
        weighted = weight * (flow - h * (share * (h * flow).sum(axis=1))[:, None])
        FT, WFT = flow.reshape(6, -1), weighted.reshape(6, -1)
        try:
            inverse = np.linalg.inv(WFT @ FT.T)
        except np.linalg.LinAlgError:
            return None
        change = inverse @ (WFT @ misfit.reshape(-1))
        rates = rates + change
        if float(np.abs(change @ FT).max()) < settled:
            break
    agrees = distance < _INLIER_SIGMAS * noise
    likely = bool(_is_likely(rates, prior, settings))
    least = settings.least_points if likely else max(settings.least_surprising, settings.majority * seen.shape[1])
    bend = _bend(points, h, weight * share, misfit, flow, weighted, noise)
    near = agrees | (distance < settings.near_px / settings.f_px)
    disagreeing = disagreement(agrees[near], picture[1, near])
    step = RigidStep(rates, noise**2 * inverse, agrees, disagreeing, noise, likely, bend)
    return None if noise > most or step.inliers < least else step


def _bend(
    points: PointsInStep,
    h: FloatArray,
    weight: FloatArray,
    misfit: FloatArray,
    flow: FloatArray,
    weighted_flow: FloatArray,
    noise: float,
) -> Bend:
    """Return what is told of disparities that are too small by (b, c) · places: least squares of r = h (b, c) · places,
    what else moves the points eliminated (Schur): the motion's six unknowns, and accelerations that are not known.

    `weight` (N,) is that of a misfit along h, hᵀ r; `weighted_flow` is `flow` (6, 2, N) times the inverse covariance of
    all misfits r.
    """
    places = weight * points.places
    unknowns, weighted_unknowns = points.with_accelerations(flow), points.with_accelerations(weighted_flow)
    count = len(unknowns)
    normal = weighted_unknowns.reshape(count, -1) @ unknowns.reshape(count, -1).T
    normal[range(6, count), range(6, count)] += (noise / points.acceleration_sd) ** 2
    with_unknowns = (h * unknowns).sum(axis=1) @ places.T
    eliminated = np.linalg.solve(normal, with_unknowns).T
    information = ((h * h).sum(axis=0) * places) @ points.places.T - eliminated @ with_unknowns
    weighted = places @ (h * misfit).sum(axis=0) - eliminated @ (weighted_unknowns.reshape(count, -1) @ misfit.ravel())
    return Bend(information / noise**2, weighted / noise**2)


def _across(vectors: FloatArray) -> FloatArray:
    """Return [v]× (N, 3, 3) of each of `vectors` (N, 3)."""
    across = np.zeros((len(vectors), 3, 3))
    across[:, 2, 1], across[:, 0, 2], across[:, 1, 0] = vectors.T
    across -= across.transpose(0, 2, 1)
    return across


def _turned_back(points: FloatArray, rate: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return exp(−[rate]× t) X for points (3, N), each with its own t (N,)."""
    rate_radps = math.hypot(*rate)
    if rate_radps == 0.0:
        return points
    across = so3.skew(rate / rate_radps)
    angles_rad = -rate_radps * times_s
    once = across @ points
    turned: FloatArray = points + np.sin(angles_rad) * once + (1.0 - np.cos(angles_rad)) * (across @ once)
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
