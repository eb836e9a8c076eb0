"""The edges of the last seconds, fixed in W while the wearer walks over them: each the better known the more frames
saw it.

An edge is the line n · (x − q) = 0 in W, n = (cos φ, sin φ) its normal and t = (−sin φ, cos φ) along it. Seen from a
camera at p with its heading ψ, u = (cos ψ, sin ψ), a distance d along x of H and a yaw ε mean

    q = p + d u,      φ = ψ + ε.                                                                                (1)

The offset e of q along n and φ have one Kalman filter, of covariance P; the rise has its own. The line turns about the
place q where it was seen, not about where the walk began: by an error δ of φ it lies, where the path crosses it now, τ
farther along t, at the offset

    e' = e − τ δ,      τ = t · (p + d u − q),      d = n · (q − p) / n · u.                                     (2)

What frames have in common (the matcher's offset, attitude) does not average out: it is added when an edge is told.

At one place there is one edge: what is seen there is that edge, however high. A rise that contradicts the one known is
left out, until as many frames in a row do as it takes to forget an edge; then it replaces it. A rise that is only
inferred does not become surer, and what is measured replaces it.

From afar treads are slivers that many frames do not show as surfaces. Where known edges, of rises r_k with variances
P_k, all lie between two surfaces that follow one another in a frame, it measures their sum, s = Σ r_k + n, so that

    r_k ← r_k + P_k (s − Σ r_k) / (Σ P_k + R),      P_k ← P_k − P_k² / (Σ P_k + R).                             (3)
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from messages.arrays import FloatArray
from perception.terrain.edges import SLOPE_APART, Edge, side_by_side
from perception.terrain.surfaces import Surface
from perception.terrain.way import Way


@dataclass(frozen=True)
class MemorySettings:
    """An edge is told once `confirmed` frames saw it, forgotten when it lies `behind_m` behind or so many
    `contradicted` it.

    `nearest_m` is how near two edges may be to be taken for one.
    """

    confirmed: int = 3
    contradicted: int = 3
    behind_m: float = 0.30
    nearest_m: float = 0.09
    most: int = 24


@dataclass
class _Known:
    """One edge: q (2,) and φ of (1) with P (2, 2), the rise and its variance."""

    q_W_m: FloatArray
    phi_rad: float
    P: FloatArray
    rise_m: float
    rise_var_m2: float
    bound_only: bool
    inferred: bool
    seen: int = 1
    contradicted: int = 0
    otherwise: int = 0
    """Frames in a row whose rise contradicted this one."""

    def in_heading(self, p_W_m: FloatArray, heading_rad: float) -> Edge:
        """Return the edge as it is seen now."""
        distance_m, tau_m = self._crossing(p_W_m, heading_rad)
        yaw_rad = math.remainder(self.phi_rad - heading_rad, math.tau)
        var_m2 = self.P[0, 0] - 2.0 * tau_m * self.P[0, 1] + tau_m**2 * self.P[1, 1]
        return Edge(
            distance_m=distance_m,
            distance_sd_m=math.hypot(math.sqrt(var_m2) / math.cos(yaw_rad), _DISTANCE_COMMON_M),
            rise_m=self.rise_m,
            rise_sd_m=math.hypot(math.sqrt(self.rise_var_m2), _RISE_COMMON_M),
            yaw_rad=yaw_rad,
            yaw_sd_rad=math.sqrt(self.P[1, 1]),
            bound_only=self.bound_only,
            inferred=self.inferred,
        )

    def fuse_line(self, edge: Edge, p_W_m: FloatArray, heading_rad: float) -> None:
        """Correct q and φ by an `edge` that a camera at `p_W_m` saw: its distance and its yaw err independently."""
        distance_m, tau_m = self._crossing(p_W_m, heading_rad)
        self.q_W_m = p_W_m + distance_m * np.array([math.cos(heading_rad), math.sin(heading_rad)])
        turned = np.array([[1.0, -tau_m], [0.0, 1.0]])  # (2)
        self.P = turned @ self.P @ turned.T
        along = math.cos(self.phi_rad - heading_rad)
        self._correct(0, (edge.distance_m - distance_m) * along, (edge.distance_sd_m * along) ** 2)
        self._correct(1, math.remainder(heading_rad + edge.yaw_rad - self.phi_rad, math.tau), edge.yaw_sd_rad**2)

    def _crossing(self, p_W_m: FloatArray, heading_rad: float) -> tuple[float, float]:
        """Return d and τ of (2)."""
        x_m, y_m = (self.q_W_m - p_W_m).tolist()
        cos, sin = math.cos(self.phi_rad), math.sin(self.phi_rad)
        yaw_rad = self.phi_rad - heading_rad
        distance_m = (cos * x_m + sin * y_m) / math.cos(yaw_rad)
        return distance_m, sin * x_m - cos * y_m - distance_m * math.sin(yaw_rad)

    def _correct(self, which: int, off: float, var: float) -> None:
        """Take in that q (0) or φ (1) is `off` from what it was taken for, with variance `var`."""
        column = self.P[:, which].copy()
        share = column / (column[which] + var)
        self.q_W_m = self.q_W_m + share[0] * off * np.array([math.cos(self.phi_rad), math.sin(self.phi_rad)])
        self.phi_rad += float(share[1]) * off
        self.P = self.P - np.outer(share, column)


class EdgeMemory:
    """Remembers edges from frame to frame; `update` takes one frame."""

    def __init__(self, settings: MemorySettings | None = None) -> None:
        self._settings = settings or MemorySettings()
        self._known: list[_Known] = []
        self._way = Way()

    def update(
        self, t_ns: int, v_W_mps: FloatArray, heading_rad: float, edges: Sequence[Edge], surfaces: Sequence[Surface]
    ) -> list[Edge]:
        """Return the confirmed edges in H, by distance, after a frame at `t_ns` has shown `edges` and `surfaces`.

        `v_W_mps` (2,) is the camera's horizontal velocity then.
        """
        self._move(t_ns, v_W_mps)
        unmatched = list(edges)
        for known in self._known:
            expected = known.in_heading(self._way.p_W_m, heading_rad)
            same = [edge for edge in unmatched if self._are_one(expected, edge)]
            if same:
                nearest = min(same, key=lambda edge: abs(edge.distance_m - expected.distance_m))
                unmatched.remove(nearest)
                self._fuse(known, nearest, heading_rad)
            elif _goes_on(surfaces, expected) or any(_stands_instead(edge, expected) for edge in edges):
                known.contradicted += 1
        self._fuse_sums(surfaces, heading_rad)
        self._known += [self._new(edge, heading_rad) for edge in unmatched]
        self._forget(heading_rad)
        return self._told(self._way.p_W_m, heading_rad)

    def expected(self, t_ns: int, v_W_mps: FloatArray, heading_rad: float) -> list[Edge]:
        """Return the confirmed edges as they lie in H, by distance, at a time after the last frame."""
        return self._told(self._way.at(t_ns, v_W_mps), heading_rad) if self._way.is_known(t_ns) else []

    def expected_yaw_rad(self, heading_rad: float) -> float:
        """Return the yaw of the nearest edge ahead that is confirmed; 0 where none is."""
        ahead = [edge for edge in self._told(self._way.p_W_m, heading_rad) if edge.distance_m > 0.0]
        return ahead[0].yaw_rad if ahead else 0.0

    @property
    def _confirmed(self) -> list[_Known]:
        return [known for known in self._known if known.seen >= self._settings.confirmed]

    def _told(self, p_W_m: FloatArray, heading_rad: float) -> list[Edge]:
        edges = (known.in_heading(p_W_m, heading_rad) for known in self._confirmed)
        return sorted(edges, key=lambda edge: edge.distance_m)

    def _move(self, t_ns: int, v_W_mps: FloatArray) -> None:
        dt_s = self._way.move(t_ns, v_W_mps)
        if dt_s is None:
            self._known.clear()
        for known in self._known:
            known.P = known.P + _WANDERS * (dt_s or 0.0)
            known.rise_var_m2 += _RISE_M_PER_SQRT_S**2 * (dt_s or 0.0)

    def _are_one(self, expected: Edge, edge: Edge) -> bool:
        near = abs(edge.distance_m - expected.distance_m) < self._settings.nearest_m
        return near and edge.rise_m * expected.rise_m > 0.0

    def _fuse(self, known: _Known, edge: Edge, heading_rad: float) -> None:
        known.fuse_line(edge, self._way.p_W_m, heading_rad)
        self._fuse_rise(known, self._new(edge, heading_rad))
        known.seen += 1
        known.contradicted = 0

    def _fuse_rise(self, known: _Known, seen: _Known) -> None:
        if (seen.bound_only and not known.bound_only) or (seen.inferred and not known.inferred):
            return
        if known.inferred:
            known.rise_m, known.rise_var_m2, known.inferred = seen.rise_m, seen.rise_var_m2, seen.inferred
            return
        known.otherwise = 0 if _agree(known, seen) else known.otherwise + 1
        if known.otherwise == 0 and not known.bound_only:
            known.rise_m, known.rise_var_m2 = _joined(known.rise_m, known.rise_var_m2, seen.rise_m, seen.rise_var_m2)
            return
        # a value replaces a bound, a lower bound a higher one
        better = not seen.bound_only or seen.rise_m < known.rise_m
        if better if known.otherwise == 0 else known.otherwise >= self._settings.contradicted:
            known.rise_m, known.rise_var_m2, known.bound_only = seen.rise_m, seen.rise_var_m2, seen.bound_only
            known.otherwise = 0

    def _fuse_sums(self, surfaces: Sequence[Surface], heading_rad: float) -> None:
        """Correct drops that this frame shows together, (3)."""
        lips = sorted(
            ((known.in_heading(self._way.p_W_m, heading_rad).distance_m, known) for known in self._confirmed),
            key=lambda lip: lip[0],
        )
        for before, after in pairwise(side_by_side(surfaces)):
            between = [(at_m, each) for at_m, each in lips if before.to_m - _AT_END_M < at_m < after.from_m]
            if len(between) < 2 or any(each.bound_only or each.rise_m > 0.0 for _, each in between):
                continue
            (first_m, _), (last_m, _) = between[0], between[-1]
            sum_m = after.at(last_m) - before.at(first_m) - before.slope * (last_m - first_m)
            hidden_m = SLOPE_APART * (last_m - first_m)
            noise_m2 = before.sd_at(first_m) ** 2 + after.sd_at(last_m) ** 2 + hidden_m**2
            off_m = sum_m - sum(each.rise_m for _, each in between)
            var_m2 = noise_m2 + sum(each.rise_var_m2 for _, each in between)
            if off_m**2 > _SUM_SIGMAS**2 * var_m2:
                continue
            for _, each in between:
                gain = each.rise_var_m2 / var_m2
                each.rise_m += gain * off_m
                each.rise_var_m2 *= 1.0 - gain

    def _new(self, edge: Edge, heading_rad: float) -> _Known:
        u = np.array([math.cos(heading_rad), math.sin(heading_rad)])
        return _Known(
            q_W_m=self._way.p_W_m + edge.distance_m * u,
            phi_rad=heading_rad + edge.yaw_rad,
            P=np.diag([(edge.distance_sd_m * math.cos(edge.yaw_rad)) ** 2, edge.yaw_sd_rad**2]),
            rise_m=edge.rise_m,
            rise_var_m2=edge.rise_sd_m**2,
            bound_only=edge.bound_only,
            inferred=edge.inferred,
        )

    def _forget(self, heading_rad: float) -> None:
        limits = self._settings

        def stays(known: _Known) -> bool:
            edge = known.in_heading(self._way.p_W_m, heading_rad)
            return -limits.behind_m < edge.distance_m < _FARTHEST_M and known.contradicted < limits.contradicted

        self._known = [known for known in self._known if stays(known)][-limits.most :]


def _joined(value: float, var: float, other: float, other_var: float) -> tuple[float, float]:
    """Return the mean of two values weighted by their variances, and its variance."""
    gain = var / (var + other_var)
    return value + gain * (other - value), (1.0 - gain) * var


def _agree(known: _Known, seen: _Known) -> bool:
    """Return whether two rises may be the same; against a bound: whether the value is no smaller drop."""
    apart_m = _RISE_APART_M + 3.0 * math.sqrt(known.rise_var_m2 + seen.rise_var_m2)
    deeper_m = known.rise_m - seen.rise_m
    return seen.bound_only or (deeper_m > -apart_m and (known.bound_only or deeper_m < apart_m))


def _stands_instead(seen: Edge, expected: Edge) -> bool:
    """Return whether an edge was seen so near to where another is expected that no tread fits in between."""
    return seen.rise_m * expected.rise_m > 0.0 and abs(seen.distance_m - expected.distance_m) < _NO_TREAD_M


def _goes_on(surfaces: Sequence[Surface], edge: Edge) -> bool:
    """Return whether ground is seen on both sides of where an edge is expected, and rises by less than half as much."""
    before, after = (_reaching(surfaces, edge.distance_m + off_m) for off_m in (-_GOES_ON_M, _GOES_ON_M))
    if before is None or after is None:
        return False
    return abs(after.at(edge.distance_m) - before.at(edge.distance_m)) < 0.5 * abs(edge.rise_m)


def _reaching(surfaces: Sequence[Surface], u_m: float) -> Surface | None:
    return next((surface for surface in surfaces if surface.from_m < u_m < surface.to_m), None)


_POSITION_M_PER_SQRT_S = 0.008
_YAW_RAD_PER_SQRT_S = 0.01
_WANDERS = np.diag([_POSITION_M_PER_SQRT_S**2, _YAW_RAD_PER_SQRT_S**2])
"""What P grows by in a second."""
_RISE_M_PER_SQRT_S = 0.01
_DISTANCE_COMMON_M = 0.006
_RISE_COMMON_M = 0.002
_RISE_APART_M = 0.03
_AT_END_M = 0.05
"""Before the end of a surface its own lip may be told."""
_SUM_SIGMAS = 3.0
_GOES_ON_M = 0.10
_NO_TREAD_M = 0.15
_FARTHEST_M = 4.0
