"""The attitude filter run over whole recordings, and its errors against the truth; VQF beside it."""

import time
from dataclasses import dataclass

import numpy as np

from messages import Residual
from messages.arrays import FloatArray, IntArray, rms
from messages.extras import needs
from perception.attitude.filter import AttitudeFilter, AttitudeSettings

UNCALIBRATED = Residual(specific_force_mps2=0.05, scale=0.005)
"""What BROAD's and the foot's IMU, never calibrated, may be off: 5 mg, half a per cent."""

CALIBRATED = Residual(specific_force_mps2=0.0147, scale=0.0005)

_SIGMA_AS_IT_IS = -1.0
"""VQF's own deviation of a bias that it is given."""


@dataclass(frozen=True)
class Estimate:
    """What the filter said after each of n samples; NaN before its start. `cost_us` is the time of one update."""

    R_WB: FloatArray
    w_B: FloatArray
    cov_W: FloatArray
    cost_us: float

    @property
    def up_B(self) -> FloatArray:
        """Return the vertical in B, (n, 3)."""
        return self.R_WB[:, 2, :]

    def up_B_ahead(self, ahead_s: float) -> FloatArray:
        """Return the vertical `ahead_s` after each sample, had the body turned on at its rate."""
        turn = ahead_s * np.cross(self.up_B, self.w_B)
        ahead = self.up_B + turn + 0.5 * ahead_s * np.cross(turn, self.w_B)
        return np.asarray(ahead / np.linalg.norm(ahead, axis=1, keepdims=True), dtype=np.float64)


def estimate(t_ns: IntArray, sf_B: FloatArray, w_B: FloatArray, residual: Residual) -> Estimate:
    """Return what the filter says, with its default settings."""
    attitude = AttitudeFilter(AttitudeSettings(), residual)
    R_WB, rates, cov_W = [], [], []
    spent_s = 0.0
    for t, sf, w in zip(t_ns.tolist(), sf_B.tolist(), w_B.tolist(), strict=True):
        begin_s = time.perf_counter()
        attitude.update(t, tuple(sf), tuple(w))
        spent_s += time.perf_counter() - begin_s
        R_WB.append(attitude.R_WB)
        rates.append(attitude.w_WB_B)
        cov_W.append(attitude.rotation_cov_W)
    return Estimate(np.array(R_WB), np.array(rates), np.array(cov_W), 1e6 * spent_s / len(t_ns))


def coverage(tilt_W: FloatArray, cov_W: FloatArray) -> float:
    """Return the share of tilt errors (n, 2) inside the stated 95 % ellipse (χ² of two degrees of freedom, 5.99)."""
    squares = np.einsum("ni,nij,nj->n", tilt_W, np.linalg.inv(cov_W[:, :2, :2]), tilt_W)
    return float(np.mean(squares < 5.99))


def tilt_of_up_W(R_WB: FloatArray, true_up_B: FloatArray) -> FloatArray:
    """Return the tilt (n, 2) in W, rad, from an estimate to the true vertical seen in B."""
    up_W = np.einsum("nij,nj->ni", R_WB, true_up_B)
    return np.stack((-up_W[:, 1], up_W[:, 0]), axis=1)


def tilt_errors_W(R_WB: FloatArray, truth_R_WB: FloatArray) -> FloatArray:
    """Return the horizontal part, (n, 2) in rad, of the small rotation in W from estimate to truth."""
    up_W = np.einsum("nij,nj->ni", R_WB, truth_R_WB[:, 2, :])
    angle = np.arctan2(np.hypot(up_W[:, 0], up_W[:, 1]), up_W[:, 2])
    scale = angle / np.maximum(np.sin(angle), 1e-12)
    tilt: FloatArray = np.stack((-up_W[:, 1], up_W[:, 0]), axis=1) * scale[:, np.newaxis]
    return tilt


def up_B_of(q_WB: FloatArray) -> FloatArray:
    """Return the vertical in B, (n, 3), of attitudes (n, 4)."""
    w, x, y, z = q_WB.T
    return np.stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z), axis=1)


def vqf_up_B(sf_B: FloatArray, w_B: FloatArray, rate_hz: float, *, any_bias: bool = False) -> FloatArray:
    """Return the vertical (n, 3) of VQF without magnetometer, defaults, at the end of each sample's period.

    Its defaults allow the gyroscope a bias of 2 °/s; with `any_bias` it may be larger (biasClip 10 °/s), and begins as
    the mean rate of the first second. Raises UserError where VQF is not installed.
    """
    needs("the comparison with VQF", "vqf")
    from vqf import VQF

    w_B = np.ascontiguousarray(w_B)
    peer = VQF(1.0 / rate_hz, biasClip=10.0) if any_bias else VQF(1.0 / rate_hz)
    if any_bias:
        peer.setBiasEstimate(np.ascontiguousarray(w_B[: round(rate_hz)].mean(axis=0)), _SIGMA_AS_IT_IS)
    return up_B_of(peer.updateBatch(w_B, np.ascontiguousarray(sf_B))["quat6D"])


def rms_deg(angles_rad: FloatArray) -> float:
    """Return the root mean square in degrees."""
    return float(np.degrees(rms(angles_rad)))
