"""How well the filter, and VQF beside it, tell the vertical over a log, and whether the filter knows how well."""

from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from lab.evaluation.attitude import UNCALIBRATED, estimate, rms_deg, tilt_of_up_W, vqf_up_B
from lab.evaluation.imu_logs.log import ImuLog
from lab.evaluation.imu_logs.truth import imu_delay_s, sound, true_vertical_W
from messages.arrays import BoolArray, FloatArray, IntArray

FROM_S = 3.0
"""Errors count from so long after the log's first sample."""
FIRST_S = 15.0
"""What is said of the beginning ends so long after the log's first sample."""
CHI_SQUARE_95 = 5.99
"""Two degrees of freedom."""


class Inclination(msgspec.Struct, frozen=True, kw_only=True):
    """Errors in degrees: root mean square and 99th percentile of all, 99th percentile of the beginning."""

    rms_deg: float
    p99_deg: float
    first_p99_deg: float


class TrialScore(msgspec.Struct, frozen=True, kw_only=True):
    """One log. `coverage` is the share of errors inside the stated 95 % ellipse, `stated_deg` the stated deviation of
    both axes together, RMS; the truth was tilted by `levelled_deg`, the IMU's stamps are `delay_s` later than its own.
    """

    name: str
    seconds: float
    judged: int
    this_filter: Inclination
    coverage: float
    stated_deg: float
    vqf: Inclination
    vqf_defaults: Inclination
    levelled_deg: float
    delay_s: float
    update_us: float


class Judged(msgspec.Struct, frozen=True):
    """One log's score and the errors in rad that it was made of: (k,) of both filters and, of this one, whether each is
    inside its ellipse."""

    score: TrialScore
    errors_rad: FloatArray
    vqf_errors_rad: FloatArray
    inside: BoolArray


def judge(log: ImuLog, *, level: bool) -> Judged:
    """Return the score of `log`; with `level` against the vertical that its accelerometer and its truth agree on.

    Raises UserError where VQF is not installed, or the truth's clock is not the IMU's.
    """
    believed = sound(log)
    delay_s = imu_delay_s(log, believed)
    log = replace(log, truth=log.truth._replace(t_ns=log.truth.t_ns + round(1e9 * delay_s)))
    up_W = true_vertical_W(log, believed) if level else np.array((0.0, 0.0, 1.0))
    log = log.averaged()
    true_up_B = _up_B(log, up_W)
    ours = estimate(log.t_ns, log.sf_B, log.w_B, UNCALIBRATED)
    t_s = 1e-9 * (log.truth.t_ns - log.t_ns[0])
    seen = log.judged & believed & (t_s >= FROM_S) & (log.truth.t_ns <= log.t_ns[-1])
    up_B = _at(log.truth.t_ns, log.t_ns, ours.up_B)
    nearest = np.clip(np.searchsorted(log.t_ns, log.truth.t_ns), 0, len(log.t_ns) - 1)
    inside = _inside(ours.R_WB[nearest], ours.cov_W[nearest], true_up_B - up_B)
    counted = seen & np.isfinite(up_B).all(axis=1)
    end_ns = log.t_ns + round(0.5e9 / log.rate_hz)
    vqf, vqf_defaults = (
        _angles(_at(log.truth.t_ns, end_ns, vqf_up_B(log.sf_B, log.w_B, log.rate_hz, any_bias=any_bias)), true_up_B)
        for any_bias in (True, False)
    )
    errors = _angles(up_B, true_up_B)
    variances = ours.cov_W[nearest[counted], 0, 0] + ours.cov_W[nearest[counted], 1, 1]
    first = t_s < FIRST_S
    score = TrialScore(
        name=log.name,
        seconds=1e-9 * float(log.t_ns[-1] - log.t_ns[0]),
        judged=int(counted.sum()),
        this_filter=_inclination(errors, counted, first),
        coverage=float(np.mean(inside[counted])) if counted.any() else float("nan"),
        stated_deg=float(np.degrees(np.sqrt(variances.mean()))) if counted.any() else float("nan"),
        vqf=_inclination(vqf, counted, first),
        vqf_defaults=_inclination(vqf_defaults, counted, first),
        levelled_deg=float(np.degrees(np.arccos(np.clip(up_W[2], -1.0, 1.0)))),
        delay_s=delay_s,
        update_us=ours.cost_us,
    )
    return Judged(score, errors[counted], vqf[counted], inside[counted])


class Together(msgspec.Struct, frozen=True, kw_only=True):
    """All logs of a folder: means over the logs, and RMS and coverage over all errors as one."""

    mean_rms_deg: float
    mean_first_p99_deg: float
    vqf_mean_rms_deg: float
    vqf_mean_first_p99_deg: float
    pooled_rms_deg: float
    pooled_p99_deg: float
    vqf_pooled_rms_deg: float
    vqf_pooled_p99_deg: float
    pooled_coverage: float


def together(trials: Sequence[Judged]) -> Together:
    """Return the figures of all `trials`, one or more."""
    errors = np.concatenate([t.errors_rad for t in trials])
    vqf = np.concatenate([t.vqf_errors_rad for t in trials])
    ours, peers = [t.score.this_filter for t in trials], [t.score.vqf for t in trials]
    return Together(
        mean_rms_deg=_mean([each.rms_deg for each in ours]),
        mean_first_p99_deg=_mean([each.first_p99_deg for each in ours]),
        vqf_mean_rms_deg=_mean([each.rms_deg for each in peers]),
        vqf_mean_first_p99_deg=_mean([each.first_p99_deg for each in peers]),
        pooled_rms_deg=rms_deg(errors),
        pooled_p99_deg=_p99_deg(errors),
        vqf_pooled_rms_deg=rms_deg(vqf),
        vqf_pooled_p99_deg=_p99_deg(vqf),
        pooled_coverage=_mean(np.concatenate([t.inside for t in trials]).tolist()),
    )


def _mean(values: Sequence[float]) -> float:
    """Return the mean of those that are not NaN; NaN of none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")


def _inclination(errors_rad: FloatArray, counted: BoolArray, first: BoolArray) -> Inclination:
    every, early = errors_rad[counted], errors_rad[counted & first]
    return Inclination(
        rms_deg=rms_deg(every) if every.size else float("nan"), p99_deg=_p99_deg(every), first_p99_deg=_p99_deg(early)
    )


def _p99_deg(errors_rad: FloatArray) -> float:
    return float(np.degrees(np.percentile(errors_rad, 99.0))) if errors_rad.size else float("nan")


def _up_B(log: ImuLog, up_W: FloatArray) -> FloatArray:
    """Return the true vertical in B, (m, 3): R_WBᵀ up_W."""
    R_WB = Rotation.from_quat(log.truth.q_WB[:, (1, 2, 3, 0)])
    return np.asarray(R_WB.inv().apply(up_W), dtype=np.float64)


def _at(t_ns: IntArray, known_ns: IntArray, up_B: FloatArray) -> FloatArray:
    """Return the vertical (m, 3) at other times, interpolated; NaN beside a NaN."""
    t_s, known_s = 1e-9 * (t_ns - known_ns[0]), 1e-9 * (known_ns - known_ns[0])
    between = np.stack([np.interp(t_s, known_s, column) for column in up_B.T], axis=1)
    return np.asarray(between / np.linalg.norm(between, axis=1, keepdims=True), dtype=np.float64)


def _angles(up_B: FloatArray, true_up_B: FloatArray) -> FloatArray:
    """Return the angles (m,) between two verticals."""
    half_chord = 0.5 * np.linalg.norm(up_B - true_up_B, axis=1)
    return np.asarray(2.0 * np.arcsin(np.clip(half_chord, 0.0, 1.0)), dtype=np.float64)


def _inside(R_WB: FloatArray, cov_W: FloatArray, chord_B: FloatArray) -> BoolArray:
    """Return whether each error, estimate to truth (m, 3) in B, is inside the 95 % ellipse; False before the start."""
    started = np.isfinite(cov_W[:, 0, 0])
    tilt_W = tilt_of_up_W(R_WB[started], chord_B[started])
    squares = np.einsum("ni,nij,nj->n", tilt_W, np.linalg.inv(cov_W[started, :2, :2]), tilt_W)
    inside = np.zeros(len(cov_W), dtype=bool)
    inside[started] = squares < CHI_SQUARE_95
    return inside
