"""How fast the wearer goes, and whether faster or slower: the hip's speed without what each step adds to it.

Along the way the hip goes at

    ṡ = v + h(θ) · w,      h = (cos θ, sin θ, cos 2θ, sin 2θ),                                                  (1)

faster and slower once a step (2θ) and, who limps, once a stride (θ). v changes by an acceleration a that is of either
sign and lasts for τ_a, with the variance σ_a² (Singer, IEEE Trans. AES 6, 1970):

    s̈ = a,      ȧ = −a / τ_a + white noise of the density q = 2 σ_a² / τ_a.                                     (2)

Of what acted at one instant there remains after τ

    Φ(τ) of (s, v, a):  a e^(−τ/τ_a),  a g,  a τ_a (τ − g),      g = τ_a (1 − e^(−τ/τ_a)),                       (3)

and of the noise since Q(τ) = q ∫ f(u) f(u)ᵀ du, f the last column of Φ. A Kalman filter has v, a and w as its state:
what is known of w from the steps before tells a change of speed from the ripple within one step.

σ_a and the noise are those of changing speed, and most steps are even. How much of the filter's covariance P the walk
asks for, its innovations e, of variance S, say over the last strides:

    P' = min(1, n ⟨e² / S⟩) P,                                                                                  (4)

n of neighbours alike, since what (1) and (2) miss lasts for a part of a step.
"""

import math
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray


class Gone(NamedTuple):
    """The way from now on (m) and the speed (m/s) after a time, and their covariance (2, 2)."""

    way_m: float
    speed_mps: float
    cov: FloatArray


class WalkingSpeed:
    """The filter of (v, a, w), which begins at `speed_mps`."""

    def __init__(self, speed_mps: float) -> None:
        self._state = np.array([speed_mps, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._cov = np.diag(np.square([_FIRST_MPS, _SIGMA_MPS2, *_RIPPLE_MPS]))
        self._share = 1.0

    def see(self, since_s: float, theta: float, speed_mps: float) -> None:
        """Take the hip's speed at the phase θ, `since_s` after the last one."""
        F, noise = np.eye(_STATES), np.diag([0.0, 0.0, *(4 * [_RIPPLE_WALK_MPS_PER_SQRT_S**2 * since_s])])
        F[:2, :2] = _transition(since_s)[1:, 1:]
        noise[:2, :2] = _noise_cov(since_s)[1:, 1:]
        self._state, cov = F @ self._state, F @ self._cov @ F.T + noise
        h = np.concatenate(([1.0, 0.0], _harmonics(theta)))
        off_mps, variance = float(speed_mps - h @ self._state), float(h @ cov @ h) + _NOISE_MPS**2
        self._share += (1.0 - math.exp(-since_s / _SHARE_S)) * (_ALIKE * off_mps**2 / variance - self._share)
        gain = cov @ h / variance
        self._state = self._state + gain * off_mps
        self._cov = cov - np.outer(gain, h @ cov)

    def ahead(self, tau_s: float, theta: float, theta_radps: float) -> Gone:
        """Return how far the wearer goes in `tau_s` from the phase θ on, growing by `theta_radps`: without the ripple,
        from where the hip would be now without it."""
        to_way = np.zeros((3, _STATES))
        to_way[1:, :2] = np.eye(2)
        to_way[0, 2:] = -_way_of_harmonics(theta) / theta_radps
        to_way = _transition(tau_s) @ to_way
        cov = min(1.0, self._share) * (to_way @ self._cov @ to_way.T + _noise_cov(tau_s))  # (4)
        way_m, speed_mps, _ = to_way @ self._state
        return Gone(float(way_m), float(speed_mps), cov[:2, :2])


def _transition(tau_s: float) -> FloatArray:
    """Return Φ of (3), (3, 3)."""
    phi = np.array([[1.0, tau_s, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    phi[:, 2] = _remains(np.array([tau_s]))[:, 0]
    return phi


def _noise_cov(tau_s: float) -> FloatArray:
    """Return Q of (3), (3, 3)."""
    at_s, weight = 0.5 * tau_s * (_NODES + 1.0), 0.5 * tau_s * _WEIGHTS
    f = _remains(at_s)
    cov: FloatArray = 2.0 * _SIGMA_MPS2**2 / _LASTS_S * (f * weight) @ f.T
    return cov


def _remains(tau_s: FloatArray) -> FloatArray:
    """Return the last column of Φ at each of `tau_s` (n,), (3, n)."""
    left = np.exp(-tau_s / _LASTS_S)
    g_s = _LASTS_S * (1.0 - left)
    return np.stack((_LASTS_S * (tau_s - g_s), g_s, left))


def _harmonics(theta: float) -> FloatArray:
    """Return h of (1)."""
    return np.array([math.cos(theta), math.sin(theta), math.cos(2.0 * theta), math.sin(2.0 * theta)])


def _way_of_harmonics(theta: float) -> FloatArray:
    """Return the integral of h over θ: what the ripple has the hip ahead, for each m/s and rad/s."""
    return np.array([math.sin(theta), -math.cos(theta), 0.5 * math.sin(2.0 * theta), -0.5 * math.cos(2.0 * theta)])


_STATES = 6
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_LASTS_S, _SIGMA_MPS2 = 0.5, 0.5
_NOISE_MPS = 0.1
"""What (1) misses of a speed, 1 σ: a strike, and what the odometer corrects."""
_FIRST_MPS = 1.0
_SHARE_S, _ALIKE = 0.5, 10.0
_RIPPLE_MPS = (0.06, 0.06, 0.15, 0.15)
"""Of who walks, 10 to 15 % of the speed once a step (Perry, Burnfield, Gait Analysis)."""
_RIPPLE_WALK_MPS_PER_SQRT_S = 0.02
