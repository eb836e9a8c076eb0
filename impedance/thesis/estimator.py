"""The platform's first estimator: low pass, derivatives, and the least absolute residual of the equations of motion.

The residuals (3) and (4) of the thesis's chapter 2, as they must be (docs/platform.md), about the plate's origin and in
P, with a the acceleration of a body's origin, g gravity, and Y⁰ the level body at rest, which the tare took away:

    ε = (Y_P − Y⁰_P) π_P − (F, T),   Y π = (m (a − g) + (α× + ω×ω×) m d,   J ω̇ + ω × J ω + m d × (a − g))         (3)
    η = (Y_P − Y⁰_P) π_P + X_PF Y_F π_F − (F, T),   X_PF (f, τ) = (R f, R τ + p_PF × R f)                         (4)

are linear in π = (m, m d, J about the origin), from which m, d and J about the centre of gravity follow one to one. So
the minima (5) and (6) of the weighted absolute residual, λ = (1, 1, 1, 2, 2, 2), are linear programmes and are solved
exactly; seed_descent descends to them as the thesis did. Moments can be kept from falling below zero, for
J_xx − m (y² + z²) ≥ 0 is convex in π: it is met by cutting planes.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.body.geometry import GRAVITY_I_MPS2
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia, cross_matrix, wrench_transform
from impedance.recording.recording import PlatformRecording, Poses
from impedance.thesis.least_absolute import least_absolute
from impedance.thesis.signals import DERIVATIVE_LOST, derivatives, low_passed
from messages.arrays import FloatArray

WEIGHTS: Final = (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)

_LEVEL: Final = Kinematics.at_rest(np.zeros((1, 3)))
_MOST_CUTS: Final = 40
_BELOW_ZERO_KGM2: Final = 1e-7


@dataclass(frozen=True)
class Variant:
    """How the residuals are formed: by default as they must be. Each other value is one deviation, for an ablation.

    `filtered`: motion and wrench pass the 40 Hz low pass first. `printed_signs`: −d × (m p̈ + m g) in place of
    + d × m (p̈ − g). `torque_twice`: (4) subtracts T_s twice. `lever`: p_PF × f of the foot counts. `tare_moment`: the
    tare took the moment of the weight too.
    """

    filtered: bool = True
    printed_signs: bool = False
    torque_twice: bool = False
    lever: bool = True
    tare_moment: bool = True


@dataclass(frozen=True)
class LinearResidual:
    """The residual `columns` (n, 6, 10) π − `wrench` (n, 6) of one body.

    `transport`: +1 where π holds J + m (|d|² 1 − d dᵀ) of the centre of gravity's J, −1 as the printed signs have it.
    """

    columns: FloatArray
    wrench: FloatArray
    transport: float

    def body(self, vector: FloatArray) -> Inertia:
        """Return the body that π (10,) describes; it need not be one that can exist."""
        plain = Inertia.from_vector(vector)
        if self.transport > 0.0:
            return plain
        return Inertia(plain.mass_kg, plain.cog_m, plain.inertia_kgm2 + 2.0 * _transport(plain))

    def vector(self, body: Inertia) -> FloatArray:
        """Return π (10,) of `body`: the inverse of `body()`."""
        if self.transport > 0.0:
            return body.vector
        return Inertia(body.mass_kg, body.cog_m, body.inertia_kgm2 - 2.0 * _transport(body)).vector

    def mean_cost(self, vector: FloatArray) -> float:
        """Return the cost (5) or (6) of π (10,)."""
        return float(np.abs(self.columns @ vector - self.wrench).mean(axis=0) @ np.array(WEIGHTS))


def _transport(body: Inertia) -> FloatArray:
    d = body.cog_m
    moved: FloatArray = body.mass_kg * (d @ d * np.eye(3) - np.outer(d, d))
    return moved


def plate_estimate(recording: PlatformRecording) -> Inertia:
    """Return the bare plate at the minimum of (5), its mass known from the settings; errors as `plate_residual` has."""
    mass_kg = recording.settings.plate.mass_kg
    return least_residual(plate_residual(recording, Variant()), mass_kg, moments_bounded=False)


def foot_estimate(recording: PlatformRecording, plate: Inertia) -> Inertia:
    """Return the foot at the minimum of (6), on a known plate; errors as `foot_residual` has."""
    return least_residual(foot_residual(recording, plate, Variant()), None, moments_bounded=False)


def plate_residual(recording: PlatformRecording, variant: Variant) -> LinearResidual:
    """Return (3) of a recording of the bare plate; raises ValueError where its streams have not the same times."""
    columns = _plate_columns(recording, variant)
    return LinearResidual(columns, _wrench(recording, variant), _transport_sign(variant))


def foot_residual(recording: PlatformRecording, plate: Inertia, variant: Variant) -> LinearResidual:
    """Return (4) of a recording of the plate with the foot, whose frame is parallel to the plate's; `plate` is known.

    Raises ValueError where the recording has no foot, or its streams have not the same times.
    """
    if recording.foot is None:
        raise ValueError("no foot in this recording")
    transport = _transport_sign(variant)
    lever_m = np.array(recording.settings.foot.origin_in_plate_m) if variant.lever else np.zeros(3)
    X_PF = wrench_transform(np.eye(3), lever_m)
    columns = X_PF @ _columns(_moved(recording.foot, recording, variant), variant)
    if recording.settings.tare.with_foot:
        columns -= X_PF @ _columns(_LEVEL, variant)
    plate_only = LinearResidual(_plate_columns(recording, variant), np.zeros(0), transport)
    wrench = _wrench(recording, variant)
    if variant.torque_twice:
        wrench[:, 3:] *= 2.0
    return LinearResidual(columns, wrench - plate_only.columns @ plate_only.vector(plate), transport)


def _plate_columns(recording: PlatformRecording, variant: Variant) -> FloatArray:
    tared = _columns(_LEVEL, variant)
    if not variant.tare_moment:
        tared[:, 3:] = 0.0
    return _columns(_moved(recording.plate, recording, variant), variant) - tared


def _columns(motion: Kinematics, variant: Variant) -> FloatArray:
    """Return Y (n, 6, 10)."""
    Y = motion.regressor
    if variant.printed_signs:
        Y[:, 3:, 1:4] = cross_matrix(motion.a_O_P + motion.g_P)
    return Y


def _moved(poses: Poses, recording: PlatformRecording, variant: Variant) -> Kinematics:
    rate_hz = recording.settings.rates.motion_hz
    p_m, euler_rad = poses.p_m, poses.euler_rad
    if variant.filtered:
        p_m, euler_rad = low_passed(p_m, rate_hz), low_passed(euler_rad, rate_hz)
    return Kinematics.of_pose(*derivatives(euler_rad, rate_hz), derivatives(p_m, rate_hz)[2])


def _wrench(recording: PlatformRecording, variant: Variant) -> FloatArray:
    if not np.array_equal(recording.t_s, recording.force_t_s):
        raise ValueError("motion and wrench are not sampled together")
    wrench = recording.wrench
    if variant.filtered:
        wrench = low_passed(wrench, recording.settings.rates.force_hz)
    inner: FloatArray = wrench[DERIVATIVE_LOST:-DERIVATIVE_LOST].copy()
    return inner


def _transport_sign(variant: Variant) -> float:
    return -1.0 if variant.printed_signs else 1.0


def mass_upright(force_n: FloatArray) -> float:
    """Return the mass (kg) of a tared plate turned upright at rest, from its force readings (n, 3).

    The tare took the weight along Y; upright, the weight pulls across Y and is read in full.
    """
    mean_n = force_n.mean(axis=0)
    return float(np.hypot(mean_n[0], mean_n[2]) / np.linalg.norm(GRAVITY_I_MPS2))


def least_residual(residual: LinearResidual, mass_kg: float | None, *, moments_bounded: bool) -> Inertia:
    """Return the body at the minimum of (5), where `mass_kg` is known, or of (6), where it is None.

    Raises ValueError where the motion leaves a parameter free.
    """
    rows = residual.columns.reshape(-1, 10)
    y = residual.wrench.reshape(-1)
    price = np.tile(WEIGHTS, len(residual.wrench))
    first = 0
    if mass_kg is not None:
        first = 1
        y = y - mass_kg * rows[:, 0]
    known = np.array([] if mass_kg is None else [mass_kg])
    X = rows[:, first:]
    vector = np.concatenate([known, least_absolute(X, y, price, price).b])
    if not moments_bounded:
        return residual.body(vector)
    cuts = np.empty((0, 10))
    cut_price = (price @ np.abs(rows))[4:7]
    prices = np.empty(0)
    for _ in range(_MOST_CUTS):
        below = np.flatnonzero(np.diag(residual.body(vector).inertia_kgm2) < -_BELOW_ZERO_KGM2)
        if len(below) == 0:
            return residual.body(vector)
        cuts = np.vstack([cuts, [_cut(vector, axis) for axis in below.tolist()]])
        prices = np.concatenate([prices, cut_price[below]])
        found = least_absolute(
            np.vstack([X, cuts[:, first:]]),
            np.concatenate([y, -cuts[:, :first] @ known]),
            np.concatenate([price, prices]),
            np.concatenate([price, np.zeros(len(prices))]),
        )
        vector = np.concatenate([known, found.b])
    raise ArithmeticError(f"moments of inertia still below zero after {_MOST_CUTS} cutting planes")


def _cut(vector: FloatArray, axis: int) -> FloatArray:
    """Return c (10,) with c π ≥ 0 where J_axis ≥ h²/m, h the first moment across the axis: its tangent at `vector`."""
    d = vector[1:4] / vector[0]
    d[axis] = 0.0
    cut = np.zeros(10)
    cut[0], cut[1:4], cut[4 + axis] = d @ d, -2.0 * d, 1.0
    return cut
