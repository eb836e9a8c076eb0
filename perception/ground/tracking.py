"""The plane over time: gradient in W, height under the camera, each with its covariance.

The gradient of the ground in W does not change while the wearer walks on it, so a Kalman filter with a small
process noise averages the frames; the height follows the hip and is re-measured by each frame. A frame that
contradicts the track (an edge: kerb, stair, foot of a ramp) starts a new one once the next frame confirms it: a chance
match of a picture that shows nothing does not come twice. Where much else than the plane is seen, it may be what a
blurred eye matches in each frame: such a one has to agree with the track as the camera's velocity carries it, and
confirms none. The attitude's error is common to all
frames of a track until the attitude is corrected: a Kalman filter that goes from covariance P to P' corrects itself by
N(0, P − P'), and the track has it still.

How uncertain the plane is, the filter's own covariance does not tell: its process noise is what lets it follow, and
frames 50 ms apart see one texture from nearly one place, so that averaging takes little off the matcher's errors. With
z the newest frame's plane, of covariance R, the track's plane x = z + (x − z), and x − z is known: to second moments

    E[(x − true)(x − true)ᵀ] = R + (x − z)(x − z)ᵀ                                                            (2)

A plane known from elsewhere, z₀, that a single picture has shown so far is either: beside (2) it has (z − z₀)(z − z₀)ᵀ,
until a second picture agrees or, where none comes any more, for as long as it is carried.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from messages.arrays import FloatArray
from perception.ground.plane import Plane, PlaneFit


@dataclass(frozen=True)
class TrackingSettings:
    """Process noise per square root of a second, and the bound on the squared innovation (χ², 3 degrees)."""

    gradient_per_sqrt_s: float = 0.02
    height_m_per_sqrt_s: float = 0.06
    attitude_jitter_rad: float = 0.003  # attitude error that changes from frame to frame
    gate: float = 16.3  # 0.1 % of frames on the track would exceed it
    longest_gap_s: float = 0.5
    confirmed_within_s: float = 0.3
    most_between: int = 1  # frames that show no plane, from the one that begins a track to the one that confirms it
    believable_share: float = 0.6  # of the region, matched, where a frame contradicts the track


@dataclass
class _Track:
    """(∂z/∂x, ∂z/∂y in W; height of the camera above the plane's intercept) at one time, with its covariance (3, 3).

    `seen_ns` is the exposure of the newest picture that shows it, before `t_ns` where the motion has carried it on.
    `attitude_cov_W` (2, 2) is what the attitude's covariance meant for the gradient then. The plane of `rough` ground
    is another one a step ahead: it is checked against the track and not averaged. `is_shown` by a picture or not yet;
    `apart` (3,) is by what the first one that shows a plane known from elsewhere differs from it, until the second.
    """

    t_ns: int
    state: FloatArray
    cov: FloatArray
    attitude_cov_W: FloatArray
    seen_ns: int
    rough: bool = False
    is_shown: bool = True
    apart: FloatArray = field(default_factory=lambda: np.zeros(3))

    def carried(self, since_s: float, v_W_mps: FloatArray) -> "_Track":
        """Return it after `since_s`, in which the camera comes away from it by v · (−a, −b, 1) a second."""
        a, b, h = self.state
        return replace(self, state=np.array([a, b, h + since_s * float(v_W_mps @ np.array([-a, -b, 1.0]))]))

    @property
    def doubt(self) -> FloatArray:
        """Return the covariance (3, 3) of a plane that a single picture has shown, beside its own."""
        return np.outer(self.apart, self.apart)


class PlaneTracker:
    """Kalman filter of the plane, and of the one that may take its place."""

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self._track: _Track | None = None
        self._candidate: _Track | None = None
        self._between = 0

    def begin(self, t_ns: int, plane: Plane, cov: FloatArray, R_WH: FloatArray, attitude_cov_W: FloatArray) -> None:
        """Go on from another `plane` in H, of which (a, b, h) has the covariance `cov` (3, 3): known from elsewhere, so
        that the next frame needs no other one to confirm it."""
        turn = _turn(R_WH)
        known = _Track(t_ns, turn @ plane.abh, turn @ cov @ turn.T, attitude_cov_W, t_ns, is_shown=False)
        self._track, self._candidate = known, None

    def carry(
        self, t_ns: int, R_WH: FloatArray, v_W_mps: FloatArray, attitude_cov_W: FloatArray
    ) -> tuple[Plane, FloatArray] | None:
        """Go on to a frame that does not show the plane; return it in H, and its covariance (a, b, h), without the
        attitude's.

        The camera moves by `v_W_mps` (3,) since the track was last brought up to a frame: the velocity of a step, so
        each frame has to be taken. None without a track that was seen within `longest_gap_s`.
        """
        track = self._track
        if track is None or self._is_too_old(track, t_ns):
            return None
        since_s = 1e-9 * (t_ns - track.t_ns)
        grown = np.diag([0.0, 0.0, (_CARRIED_MPS * since_s) ** 2])
        cov, turn = track.cov + grown, _turn(R_WH)
        moved = track.carried(since_s, v_W_mps)
        self._track = replace(moved, t_ns=t_ns, cov=cov, attitude_cov_W=attitude_cov_W)
        return _plane(turn.T @ moved.state), turn.T @ (cov + track.doubt) @ turn

    def miss(self) -> None:
        """Take a frame that shows no plane."""
        self._between += 1
        if self._between > self._settings.most_between:
            self._candidate = None

    def forget(self) -> None:
        """Follow no plane any more."""
        self._track = self._candidate = None

    def predicted(self, t_ns: int, R_WH: FloatArray) -> Plane | None:
        """Return the plane in H as expected at `t_ns`, or None without a track that was seen within `longest_gap_s`."""
        if self._track is None or self._is_too_old(self._track, t_ns):
            return None
        return _plane(_turn(R_WH).T @ self._track.state)

    def _is_too_old(self, track: _Track, t_ns: int) -> bool:
        return t_ns - track.seen_ns > 1e9 * self._settings.longest_gap_s

    def updated(
        self,
        t_ns: int,
        fit: PlaneFit,
        matched_share: float,
        R_WH: FloatArray,
        attitude_cov_W: FloatArray,
        *,
        may_begin: bool = True,
        even: bool = True,
        v_W_mps: FloatArray | None = None,
    ) -> tuple[Plane, FloatArray] | None:
        """Take one frame's plane in H; return the plane in H that the track now holds and its covariance (a, b, h).

        None where the frame contradicts the track, or there is none, and the frame before does not confirm it; one of
        which little matched confirms nothing, nor does one that `may_begin` no track. One that is not `even` confirms
        nothing either; it has to agree soon, and with the track carried at `v_W_mps` (3,), where that is known.
        `attitude_cov_W` (2, 2), rad², is what the attitude's covariance means for the gradient in W. It is told apart:
        the covariance that is returned, (2), is without it.
        """
        turn = _turn(R_WH)
        jitter = self._settings.attitude_jitter_rad**2
        seen_cov = turn @ fit.covariance @ turn.T + np.diag([jitter, jitter, 0.0])
        seen = _Track(t_ns, turn @ fit.plane.abh, seen_cov, attitude_cov_W, t_ns, rough=fit.rough_m > 0.0)
        if even:
            track = self._joined(self._track, seen, self._settings.longest_gap_s)
        else:
            track = self._joined(self._track, seen, self._settings.confirmed_within_s, v_W_mps)
        if track is None:
            candidate = self._joined(self._candidate, seen, self._settings.confirmed_within_s)
            believable = may_begin and matched_share >= self._settings.believable_share
            self._candidate, self._between = seen if believable else None, 0
            track = candidate if believable and even else None
        if track is None:
            return None
        self._track, self._candidate = track, None
        lag_H = turn.T @ (track.state - seen.state)
        return _plane(turn.T @ track.state), fit.covariance + np.outer(lag_H, lag_H) + turn.T @ track.doubt @ turn

    def _joined(
        self, before: _Track | None, seen: _Track, within_s: float, v_W_mps: FloatArray | None = None
    ) -> _Track | None:
        """Return `before` with what is seen, or None where they contradict each other, with `v_W_mps` as the height
        is carried by it, or are farther apart."""
        if before is None or seen.t_ns - before.seen_ns > 1e9 * within_s:
            return None
        since_s = max(0.0, 1e-9 * (seen.t_ns - before.t_ns))
        height_m = self._settings.height_m_per_sqrt_s * math.sqrt(since_s)
        if v_W_mps is not None:
            before, height_m = before.carried(since_s, v_W_mps), _CARRIED_MPS * since_s
        prior = self._grown(before, seen, since_s, height_m)
        innovation, innovation_cov = seen.state - before.state, prior + seen.cov
        if innovation @ np.linalg.solve(innovation_cov, innovation) > self._settings.gate:
            return None
        apart = np.zeros(3) if before.is_shown else innovation
        if seen.rough:
            return replace(seen, apart=apart)
        gain = np.linalg.solve(innovation_cov, prior).T
        state, cov = before.state + gain @ innovation, (np.eye(3) - gain) @ prior
        return replace(seen, state=state, cov=cov, apart=apart)

    def _grown(self, before: _Track, seen: _Track, since_s: float, height_m: float) -> FloatArray:
        gradient = self._settings.gradient_per_sqrt_s * math.sqrt(since_s)
        prior: FloatArray = before.cov + np.diag(np.square([gradient, gradient, height_m]))
        prior[:2, :2] += _positive_part(before.attitude_cov_W - seen.attitude_cov_W)
        return prior


_CARRIED_MPS = 0.05
"""What a velocity may be off, and the way between two frames beside it, 1 σ."""


def _positive_part(difference: FloatArray) -> FloatArray:
    """Return the symmetric matrix `difference` without its negative eigenvalues."""
    values, vectors = np.linalg.eigh(difference)
    positive: FloatArray = (vectors * np.clip(values, 0.0, None)) @ vectors.T
    return positive


def _plane(abh: FloatArray) -> Plane:
    return Plane((float(abh[0]), float(abh[1])), float(abh[2]))


def _turn(R_WH: FloatArray) -> FloatArray:
    """Return the (3, 3) matrix that takes (∂z/∂x, ∂z/∂y, height) from H to W, which differ by yaw alone."""
    turn = np.eye(3)
    turn[:2, :2] = R_WH[:2, :2]
    return turn
