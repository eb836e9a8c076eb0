"""The plate's coordinates from all markers, plate's and foot's, and whether they move as the joint lets them.

With C (6, c) of mechanism, a marker frame at r in P (0 for P itself, the mounting's lever for F) measures

    y = (p_IP_I + R r, ψ, θ, φ) + noise,   ∂y/∂q = A(r) C at level                                                 (1)
    q̂ = q0 + (Jᵀ W J)⁻¹ Jᵀ W (y − y(q0)),   Σ_q = (Jᵀ W J)⁻¹                                                       (2)

J stacks (1) over the frames and W is the inverse of the noise's covariance. y(q0) is exact; the slope at level is
enough, for q0 is off by noise alone. What (2) leaves is χ² distributed if the joint is what it is said to be.
"""

from dataclasses import dataclass

import numpy as np

from impedance.body import geometry
from impedance.identification.mechanism import FreeBody, Mechanism, UniversalJoint
from messages.arrays import FloatArray

_EULER_OF_TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""(ψ, θ, φ) of a small rotation about x, y, z."""
_REFUTED = 5.0


@dataclass(frozen=True)
class MarkerFrame:
    """What motion capture says of a frame fixed to the plate: `p_m`, `euler_rad` (n, 3), at `lever_m` (3,) in P."""

    p_m: FloatArray
    euler_rad: FloatArray
    lever_m: FloatArray


@dataclass(frozen=True)
class JointTest:
    """How far the markers are from the joint, beyond their noise.

    `mean_m`, `mean_rad` (3,): constant offsets of the first frame's position and Euler angles; `rms_m`, `rms_rad` (3,)
    what varies; `height_m` ± `height_deviation_m` is the joint's distance below the surface by which the positions
    swing; `sigmas` is how many standard deviations the sum of squares of what varies lies above its expectation, and
    `height_sigmas` how many the height lies from the one stated.
    """

    mean_m: FloatArray
    mean_rad: FloatArray
    rms_m: FloatArray
    rms_rad: FloatArray
    height_m: float
    height_deviation_m: float
    sigmas: float
    height_sigmas: float

    @property
    def holds(self) -> bool:
        """Tell whether positions and yaw move as the joint at its stated height lets them, within five deviations."""
        return self.sigmas < _REFUTED and self.height_sigmas < _REFUTED


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


def joint_test(joint: UniversalJoint, frame: MarkerFrame, position_std_m: float, angle_std_rad: float) -> JointTest:
    """Return how well `frame`, fixed to P's origin, keeps to the joint."""
    q, _ = fused(joint, [frame], position_std_m, angle_std_rad)
    left = _left(joint, frame, q)
    mean = left.mean(axis=0)
    varying = left - mean
    up_I = geometry.rotation_IP(np.zeros(len(q)), q[:, 0], q[:, 1])[:, :, 1]
    swing = up_I - up_I.mean(axis=0)
    reach = float((swing**2).sum())
    squares = (
        float((varying[:, :3] ** 2).sum()) / position_std_m**2 + float((varying[:, 3] ** 2).sum()) / angle_std_rad**2
    )
    freedom = 4 * (len(q) - 1)
    lower_m = float((swing * varying[:, :3]).sum()) / reach
    deviation_m = position_std_m / float(np.sqrt(reach))
    return JointTest(
        mean_m=mean[:3],
        mean_rad=mean[3:],
        rms_m=np.sqrt((varying[:, :3] ** 2).mean(axis=0)),
        rms_rad=np.sqrt((varying[:, 3:] ** 2).mean(axis=0)),
        height_m=joint.joint_to_surface_m + lower_m,
        height_deviation_m=deviation_m,
        sigmas=(squares - freedom) / float(np.sqrt(2.0 * freedom)),
        height_sigmas=abs(lower_m) / deviation_m,
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
        p_m, lever = np.zeros(3), frame.lever_m + np.array([0.0, mechanism.joint_to_surface_m, 0.0])
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
