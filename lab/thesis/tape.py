"""The foot on its tape: one small motion along or about one axis of P, to first order, beside a stored run.

    ẍ + 2 ζ Ω₀ ẋ + Ω₀² x = −f / m,   or about an axis with its moment and inertia in place of f and m                (1)

`systems.platform.tape` rocks about both axes at once, not to first order, and does not slide.
"""

from dataclasses import replace

import numpy as np

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import cross_matrix
from lab.thesis.signals import Signals, frequencies_hz, shaped
from messages.arrays import FloatArray
from sim_rig.platform.rig import FOOT, Rig

_ORIGIN_M = np.array(Rig().foot_origin_m)
_COG_M = _ORIGIN_M + FOOT.cog_m
_BELOW_ORIGIN_M = np.array([0.0, -_ORIGIN_M[1], 0.0])  # from F's origin to the tape


def on_sliding_tape(signals: Signals, axis: int, period_s: float, damping_ratio: float, *, seen: bool) -> Signals:
    """Return the signals when the foot, on its tape, slides along P's `axis` with a resonance of `period_s`.

    u = −f / m H with 1 / H = Ω₀² − Ω² + 2 i ζ Ω₀ Ω, f the force on the rigid foot; `seen` by the foot's markers or not.
    """
    if signals.foot is None or period_s == 0.0:
        return signals
    e = np.eye(3)[axis]
    rigid_n = _foot_wrench(signals)[:, axis]
    u, ddu = _oscillation(-(rigid_n - rigid_n.mean()) / FOOT.mass_kg, period_s, damping_ratio)
    wrench = signals.wrench.copy()
    wrench[:, :3] += FOOT.mass_kg * ddu[:, None] * e
    weight_n = -FOOT.mass_kg * signals.kinematics.g_P
    wrench[:, 3:] += FOOT.mass_kg * ddu[:, None] * np.cross(_COG_M, e) + u[:, None] * np.cross(e, weight_n)
    foot = signals.foot.copy()
    if seen:
        foot[:, :3] += u[:, None] * (geometry.rotation_IP(*signals.plate[:, 3:].T) @ e)
    return replace(signals, wrench=wrench, foot=foot)


def on_rocking_tape(signals: Signals, axis: int, period_s: float, damping_ratio: float, *, seen: bool) -> Signals:
    """Return the signals when the foot rocks on its tape about P's `axis` (0 or 2), on the plate's surface.

    As `on_sliding_tape`, with the moment on the rigid foot about P's origin and its inertia about that axis.
    """
    if signals.foot is None or period_s == 0.0:
        return signals
    e = np.eye(3)[axis]
    J_kgm2 = float(FOOT.seen_from(np.eye(3), _ORIGIN_M).vector[4 + axis])
    rigid_nm = _foot_wrench(signals)[:, 3 + axis]
    beta, ddbeta = _oscillation(-(rigid_nm - rigid_nm.mean()) / J_kgm2, period_s, damping_ratio)
    arm = np.cross(e, _COG_M)
    wrench = signals.wrench.copy()
    wrench[:, :3] += FOOT.mass_kg * ddbeta[:, None] * arm
    weight_n = -FOOT.mass_kg * signals.kinematics.g_P
    wrench[:, 3:] += J_kgm2 * ddbeta[:, None] * e + beta[:, None] * np.cross(arm, weight_n)
    foot = signals.foot.copy()
    if seen:
        R_IP = geometry.rotation_IP(*signals.plate[:, 3:].T)
        foot[:, :3] += beta[:, None] * (R_IP @ np.cross(e, -_BELOW_ORIGIN_M))
        small = np.eye(3) + beta[:, None, None] * cross_matrix(e[None])
        foot[:, 3:] = geometry.euler_of(R_IP @ small)
    return replace(signals, wrench=wrench, foot=foot)


def _foot_wrench(signals: Signals) -> FloatArray:
    """Return the wrench (n, 6) on the rigid foot, about P's origin in P."""
    wrench: FloatArray = signals.kinematics.regressor @ FOOT.seen_from(np.eye(3), _ORIGIN_M).vector
    return wrench


def _oscillation(drive: FloatArray, period_s: float, damping_ratio: float) -> tuple[FloatArray, FloatArray]:
    """Return x and ẍ (n,) of ẍ + 2 ζ Ω₀ ẋ + Ω₀² x = `drive` (n,)."""
    W0, W = 2.0 * np.pi / period_s, 2.0 * np.pi * frequencies_hz(len(drive))
    H = 1.0 / (W0**2 - W**2 + 2j * damping_ratio * W0 * W)
    x = shaped(drive[:, None], H)[:, 0]
    return x, shaped(drive[:, None], -(W**2) * H)[:, 0]


def level_foot_wrench() -> FloatArray:
    """Return the wrench (6,) that carries the foot, level and at rest."""
    wrench: FloatArray = Kinematics.at_rest(np.zeros((1, 3))).regressor[0] @ FOOT.seen_from(np.eye(3), _ORIGIN_M).vector
    return wrench
