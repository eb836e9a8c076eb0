"""White noise of the sensors: declared, or from what a recording holds above all that moves, then from the misfit.

Above 130 Hz a force plate that is shaken still holds real force: what the quiet band says is a start. Each bin of what
a fit leaves has the covariance S of impedance.identification.eiv, linear in the variances v of six channels, positions
and angles, so that the least squares of

    |r_i(f)|² / N = Σ_k v_k h_ki(f),   weighed by 1 / S_ii²                                                       (1)

tells those that nobody declared [Patterson and Thompson, Biometrika 58(3), 1971, to first order].
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from impedance.identification.eiv import EivFit, EivProblem
from impedance.identification.spectra import Spectra
from impedance.recording.synchronous import Synchronous
from messages.arrays import FloatArray

QUIET_SHARE = 0.372
"""Of the rate: nothing moves above 130 of 350 Hz."""
_LONGEST = 4096
_NAMES = ("force_n", "torque_nm", "position_m", "angle_rad")
_NEARLY = 0.999
_ROUNDS = 5
_LEAST_SHARE = 0.05
"""Of the misfit's power, in some bin: what makes less of it stays as the quiet band has it."""
_LEAST_POWER = 1e-4
"""Of what the quiet band says: no channel has less."""


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations of one sample of white noise, and which of them nobody declared.

    `wrench` (6,) are those of the channels where the misfit told them apart.
    """

    position_m: float
    angle_rad: float
    force_n: float
    torque_nm: float
    estimated: tuple[str, ...] = ()
    wrench: tuple[float, ...] | None = None

    @property
    def wrench_std(self) -> FloatArray:
        """Return the standard deviations (6,) of the wrench's channels."""
        if self.wrench is not None:
            return np.array(self.wrench)
        return np.repeat((self.force_n, self.torque_nm), 3)


def noise_level(streams: Synchronous) -> NoiseLevel:
    """Return what the settings declare; what they leave open is estimated from the content above 130 Hz (of 350)."""
    declared = streams.settings.noise
    poses = [streams.plate] if streams.foot is None else [streams.plate, streams.foot]
    found: dict[str, float] = {}
    estimated = []
    for name, channels in (
        ("position_m", np.hstack([pose.p_m for pose in poses])),
        ("angle_rad", np.hstack([pose.euler_rad for pose in poses])),
        ("force_n", streams.wrench[:, :3]),
        ("torque_nm", streams.wrench[:, 3:]),
    ):
        value = getattr(declared, name)
        if value is None:
            value = quiet_deviation(np.where(streams.valid[:, None], channels, 0.0), streams.valid)
            estimated.append(name)
        found[name] = value
    return NoiseLevel(
        found["position_m"], found["angle_rad"], found["force_n"], found["torque_nm"], estimated=tuple(estimated)
    )


def from_misfit(
    noise: NoiseLevel, problem: EivProblem, spectra: Spectra, fit: EivFit, q_cov: Callable[[float, float], FloatArray]
) -> NoiseLevel:
    """Return `noise` with what nobody declared by (1); `q_cov` (c, c) follows from noise of positions and angles."""
    M = problem.noise.mechanism.level_weighing(fit.vector[1:4] / fit.vector[0])
    _, _, G = problem.noise.weights(spectra.f_hz, fit.vector, M)
    band = spectra.share > 0.0
    G, left = G[band], fit.left[band]
    both = q_cov(noise.position_m, noise.angle_rad)
    nearly = q_cov(noise.position_m, _NEARLY * noise.angle_rad)
    of_angles = (both - nearly) / (1.0 - _NEARLY**2)
    each = [np.broadcast_to(column**2 * std**2, left.shape) for column, std in zip(M.T, noise.wrench_std, strict=True)]
    each += [np.einsum("kij,jl,kil->ki", G, cov, G, optimize=True) for cov in (both - of_angles, of_angles)]
    power = np.abs(left) ** 2 / (spectra.counted_s * spectra.rate_hz)
    parts = np.stack(each)
    unknown = np.repeat([name in noise.estimated for name in _NAMES], (3, 3, 1, 1))
    unknown &= (parts / parts.sum(axis=0)).max(axis=(1, 2)) > _LEAST_SHARE
    scale2 = np.ones(len(parts))
    for _ in range(_ROUNDS):
        weight = 1.0 / np.einsum("p,pki->ki", scale2, parts)
        rest = power - parts[~unknown].sum(axis=0)
        columns = (parts[unknown] * weight).reshape(int(unknown.sum()), -1).T
        scale2[unknown] = np.maximum(nnls(columns, (rest * weight).ravel())[0], _LEAST_POWER)
    scale = np.sqrt(scale2)
    wrench = noise.wrench_std * scale[:6]
    return replace(
        noise,
        wrench=tuple(wrench.tolist()),
        force_n=float(np.sqrt(np.mean(wrench[:3] ** 2))),
        torque_nm=float(np.sqrt(np.mean(wrench[3:] ** 2))),
        position_m=noise.position_m * float(scale[6]),
        angle_rad=noise.angle_rad * float(scale[7]),
    )


def quiet_deviation(channels: FloatArray, valid: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> float:
    """Return the standard deviation of white noise of the same density as the quiet band's, pooled over channels (n,
    c).

    It averages windowed stretches without a gap; NaN where there is none as long as 64 samples.
    """
    length = min(_LONGEST, len(valid))
    while length >= 64:
        starts = np.arange(0, len(valid) - length + 1, max(1, length // 2))
        whole = starts[[bool(valid[start : start + length].all()) for start in starts]]
        if len(whole):
            window = np.hanning(length)[:, None]
            pieces = channels[whole[:, None] + np.arange(length)]
            spectra = np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
            quiet = spectra[:, round(QUIET_SHARE * length) : length // 2]
            return float(np.sqrt(quiet.mean() / (window**2).sum()))
        length //= 2
    return float("nan")
