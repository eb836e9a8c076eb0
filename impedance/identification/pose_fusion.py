"""The plate's coordinates from all markers, plate's and foot's, and whether they move as the joint lets them.

With C (6, c) of mechanism, a marker frame at r in P (0 for P itself, the mounting's lever for F) measures

    y = (p_IP_I + R r, ψ, θ, φ) + noise,   ∂y/∂q = A(r) C at level                                                 (1)
    q̂ = q0 + (Jᵀ W J)⁻¹ Jᵀ W (y − y(q0)),   Σ_q = (Jᵀ W J)⁻¹                                                       (2)

J stacks (1) over the frames and W is the inverse of the noise's covariance. y(q0) is exact; the slope at level is
enough, for q0 is off by noise alone.

Where the joint is, the swing tells: with r from the joint to P's origin in P and the joint at c in I,

    p_IP_I = c + R r + noise,   r̂ = (Σ ΔRᵀ ΔR)⁻¹ Σ ΔRᵀ Δp,   Δ: less the mean                                       (3)

A mean alone tells c + r and not which of the two it is. What (3) and ψ = 0 leave is χ² distributed if there is a joint.
"""

from dataclasses import dataclass

import numpy as np

from impedance.body import geometry
from impedance.identification.mechanism import FreeBody, Mechanism, UniversalJoint
from messages.arrays import FloatArray

_EULER_OF_TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""(ψ, θ, φ) of a small rotation about x, y, z."""
_REFUTED = 5.0
_FARTHEST_M = 0.1
"""No joint is farther from where it is said to be: what the swing about one axis alone does not tell stays bounded."""


@dataclass(frozen=True)
class MarkerFrame:
    """What motion capture says of a frame fixed to the plate: `p_m`, `euler_rad` (n, 3), at `lever_m` (3,) in P."""

    p_m: FloatArray
    euler_rad: FloatArray
    lever_m: FloatArray


@dataclass(frozen=True)
class JointTest:
    """Where the markers see the joint, and how far they are from any joint, beyond their noise.

    `seen_m` (3,) is P's origin from the joint, in P, by (3) alone, with standard deviations `seen_deviation_m` (3,);
    `seen_sigmas` (3,) is how many of them lie between it and what is stated, and `stated_sigmas` (3,) how many if the
    stated place is as uncertain as it says. `lever_m` (3,) with covariance `lever_cov_m2` (3, 3) joins both.
    `centre_m` (3,) is the joint in I. `sigmas` is how many standard deviations the sum of squares of what is left lies
    above its expectation.
    """

    seen_m: FloatArray
    seen_deviation_m: FloatArray
    seen_sigmas: FloatArray
    stated_sigmas: FloatArray
    lever_m: FloatArray
    lever_cov_m2: FloatArray
    centre_m: FloatArray
    sigmas: float

    @property
    def holds(self) -> bool:
        """Tell whether the plate swings about one point, and that point lies where it is said to, five deviations."""
        return self.sigmas < _REFUTED and float(self.stated_sigmas.max()) < _REFUTED

    @property
    def elsewhere(self) -> bool:
        """Tell whether the markers see the joint elsewhere than stated, by five of their own deviations."""
        return float(self.seen_sigmas.max()) > _REFUTED

    @property
    def joint(self) -> UniversalJoint:
        """Return the joint where markers and statement together see it."""
        x, y, z = (float(value) for value in self.lever_m)
        a, b, c = (float(value) for value in self.centre_m)
        return UniversalJoint(y, (x, z), (a, b, c))


def fused(
    mechanism: Mechanism, frames: list[MarkerFrame], position_std_m: float, angle_std_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Return q̂ (n, c) of (2) and its covariance (c, c)."""
    weight = np.tile(np.repeat((position_std_m**-2, angle_std_rad**-2), 3), len(frames))
    J = np.vstack([_slope(frame.lever_m) @ mechanism.C for frame in frames])
    cov = np.linalg.inv((J.T * weight) @ J)
    q = _start(mechanism, frames[0])
    left = np.hstack([_left(mechanism, frame, q) for frame in frames])
    return q + left @ (cov @ (J.T * weight)).T, cov


def joint_test(
    joint: UniversalJoint,
    joint_std_m: float,
    frame: MarkerFrame,
    position_std_m: float,
    angle_std_rad: float,
    noise_share: float = 0.0,
) -> JointTest:
    """Return where the markers of `frame`, fixed to P's origin, see the joint stated at `joint` ± `joint_std_m`.

    `noise_share` is by what share the power of the noise is unsure.
    """
    R_IP = geometry.rotation_IP(*frame.euler_rad.T)
    swing, stated_m = R_IP - R_IP.mean(axis=0), joint.lever_m
    moved = frame.p_m - frame.p_m.mean(axis=0) - swing @ stated_m
    information = np.einsum("nij,nik->jk", swing, swing) / position_std_m**2
    pull = np.einsum("nij,ni->j", swing, moved) / position_std_m**2
    alone = np.linalg.inv(information + np.eye(3) / _FARTHEST_M**2)
    seen_m, deviation_m = alone @ pull, np.sqrt(np.diag(alone))
    lever_m, cov_m2 = np.zeros(3), np.zeros((3, 3))
    if joint_std_m > 0.0:
        cov_m2 = np.linalg.inv(information + np.eye(3) / joint_std_m**2)
        lever_m = cov_m2 @ pull
    left = moved - swing @ (lever_m if joint_std_m > 0.0 else seen_m)
    yaw = frame.euler_rad[:, 0] - frame.euler_rad[:, 0].mean()
    squares = float((left**2).sum()) / position_std_m**2 + float(yaw @ yaw) / angle_std_rad**2
    freedom = 4 * (len(left) - 1)
    return JointTest(
        seen_m=stated_m + seen_m,
        seen_deviation_m=deviation_m,
        seen_sigmas=np.abs(seen_m) / deviation_m,
        stated_sigmas=np.abs(seen_m) / np.hypot(deviation_m, joint_std_m),
        lever_m=stated_m + lever_m,
        lever_cov_m2=cov_m2,
        centre_m=frame.p_m.mean(axis=0) - R_IP.mean(axis=0) @ (stated_m + lever_m),
        sigmas=(squares - freedom) / float(np.hypot(np.sqrt(2.0 * freedom), noise_share * freedom)),
    )


def mounting_offset(plate: MarkerFrame, foot: MarkerFrame) -> FloatArray:
    """Return where (3,) in P the markers of `foot` lie on average, away from its stated lever."""
    R_IP = geometry.rotation_IP(*plate.euler_rad.T)
    seen_P = np.einsum("nji,nj->ni", R_IP, foot.p_m - plate.p_m)
    offset: FloatArray = seen_P.mean(axis=0) - foot.lever_m
    return offset


def _start(mechanism: Mechanism, frame: MarkerFrame) -> FloatArray:
    if isinstance(mechanism, FreeBody):
        lever_I = geometry.rotation_IP(*frame.euler_rad.T) @ frame.lever_m
        return np.hstack((frame.p_m - lever_I, frame.euler_rad))
    return frame.euler_rad[:, 1:]


def _left(mechanism: Mechanism, frame: MarkerFrame, q: FloatArray) -> FloatArray:
    """Return y − y(q) (n, 6) of (1)."""
    if isinstance(mechanism, UniversalJoint):
        euler = np.hstack((np.zeros((len(q), 1)), q))
        p_m, lever = np.array(mechanism.centre_m), frame.lever_m + mechanism.lever_m
    else:
        euler, p_m, lever = q[:, 3:], q[:, :3], frame.lever_m
    expected_m = p_m + geometry.rotation_IP(*euler.T) @ lever
    return np.hstack((frame.p_m - expected_m, frame.euler_rad - euler))


def _slope(lever_m: FloatArray) -> FloatArray:
    """Return A(r) (6, 6) of (1): what a small pose does to position and Euler angles of a frame at r."""
    slope = np.zeros((6, 6))
    slope[:3, :3] = np.eye(3)
    slope[:3, 3:] = np.cross(np.eye(3), lever_m).T  # δ × r
    slope[3:, 3:] = _EULER_OF_TURN
    return slope
