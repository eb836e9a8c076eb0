"""Inclination of this project's filter beside VQF, Mahony and Madgwick: `python -m benchmarks.attitude`.

Every filter runs with one set of parameters on all data of its column. This one's are tuned on half of BROAD's trials
and on made-up walks; VQF's defaults are at its optimum there; of the other two, the set published with BROAD and one
tuned on the same half are shown. Mahony and Madgwick are given the gyroscope's bias of the first second.
"""

import gzip
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from rich.table import Table
from vqf import VQF

from benchmarks.attitude_peers import Madgwick, Mahony, attitudes
from benchmarks.broad import HELD_OUT, TUNING, Trial, trials, up_B_of
from messages import Residual
from messages.arrays import FloatArray, IntArray, rms
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.attitude.filter import AttitudeFilter, AttitudeSettings
from tests.bench.data_folder import shared_data
from tests.bench.hip_motion import hip_motion, tilt_errors_W, with_mpu6050_noise

UNCALIBRATED = Residual(specific_force_mps2=0.05, scale=0.005)
"""What BROAD's and the foot's IMU, never calibrated, may be off: 5 mg, half a per cent."""

CALIBRATED = Residual(specific_force_mps2=0.0147, scale=0.0005)
_HALF_SAMPLE = 0.5


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


def vqf_up_B(sf_B: FloatArray, w_B: FloatArray, rate_hz: float) -> FloatArray:
    """Return the vertical (n, 3) of VQF without magnetometer, defaults, at the end of each sample's period."""
    result = VQF(1.0 / rate_hz).updateBatch(np.ascontiguousarray(w_B), np.ascontiguousarray(sf_B))
    return up_B_of(result["quat6D"])


def rms_deg(angles_rad: FloatArray) -> float:
    """Return the root mean square in degrees."""
    return float(np.degrees(rms(angles_rad)))


def broad(console: Console) -> None:
    data = trials(shared_data("broad"))
    delay_s = float(np.mean([trial.imu_delay_s() for trial in data if trial.name[:2] in TUNING]))
    peers: dict[str, Callable[[Trial], FloatArray]] = {
        "VQF": lambda t: vqf_up_B(t.sf_B, t.w_B, t.rate_hz),
        "Madgwick .12": lambda t: up_B_of(attitudes(Madgwick(0.12), t.sf_B, t.w_B, t.rate_hz)),
        "Madgwick .013": lambda t: up_B_of(attitudes(Madgwick(0.013), t.sf_B, t.w_B, t.rate_hz)),
        "Mahony .74 .0012": lambda t: up_B_of(attitudes(Mahony(0.74, 0.0012), t.sf_B, t.w_B, t.rate_hz)),
        "Mahony .06 0": lambda t: up_B_of(attitudes(Mahony(0.06, 0.0), t.sf_B, t.w_B, t.rate_hz)),
    }
    at_stamp: dict[str, list[float]] = {name: [] for name in ("this filter", *peers)}
    at_middle: dict[str, list[float]] = {name: [] for name in ("this filter", *peers)}
    covered, stated_deg, cost_us = [], [], []
    for trial in data:
        ours = estimate(trial.t_ns, trial.sf_B, trial.w_B, UNCALIBRATED)
        at_stamp["this filter"].append(rms_deg(trial.inclination_error_rad(ours.up_B, -delay_s)))
        at_middle["this filter"].append(rms_deg(trial.inclination_error_rad(ours.up_B_ahead(delay_s), 0.0)))
        truth = trial.true_up_B(-delay_s)
        counted = trial.counted & ~np.isnan(truth[:, 0])
        covered.append(coverage(tilt_of_up_W(ours.R_WB[counted], truth[counted]), ours.cov_W[counted]))
        stated_deg.append(np.degrees(np.sqrt(np.mean(ours.cov_W[counted, 0, 0] + ours.cov_W[counted, 1, 1]))))
        cost_us.append(ours.cost_us)
        for name, up_B in peers.items():
            up = up_B(trial)
            at_stamp[name].append(rms_deg(trial.inclination_error_rad(up, _HALF_SAMPLE / trial.rate_hz - delay_s)))
            at_middle[name].append(rms_deg(trial.inclination_error_rad(up, 0.0)))
    names = [trial.name[:2] for trial in data]
    table = Table(title=f"BROAD at {data[0].rate_hz:.2f} Hz: inclination RMSE, degrees")
    for column in ("", *names, "tuned on", "held out", "all"):
        table.add_column(column, justify="right")
    for title, scores in (("at the instant of the estimate", at_stamp), ("at the block's middle", at_middle)):
        table.add_row(f"[bold]{title}")
        for name, values in scores.items():
            tuned, held = (
                np.mean([v for n, v in zip(names, values, strict=True) if n in s]) for s in (TUNING, HELD_OUT)
            )
            table.add_row(name, *(f"{v:.2f}" for v in values), f"{tuned:.3f}", f"{held:.3f}", f"{np.mean(values):.3f}")
        table.add_section()
    table.add_row("in the 95 % ellipse", *(f"{100 * c:.0f} %" for c in covered), "", f"{_held(names, covered):.2f}")
    table.add_row("stated 1 σ", *(f"{s:.2f}" for s in stated_deg))
    console.print(table)
    console.print(
        f"The IMU lags the cameras by {1e3 * delay_s:.2f} ms (rates of the tuning half). An estimate's instant is that "
        "lag before the block's middle here, half a block later for the others, which integrate to the block's end. At "
        "the middle itself, this one is turned on at its rate by the lag; the others stand as they are.\n"
        f"One update takes {np.mean(cost_us):.0f} µs here (VQF is C++)."
    )


def _held(names: list[str], values: list[float]) -> float:
    return float(np.mean([v for n, v in zip(names, values, strict=True) if n in HELD_OUT]))


def walks(console: Console) -> None:
    table = Table(title="Walking, made up: MPU-6050 with calibration residual (1.5 mg, 0.05 %), 100 Hz; degrees")
    for column in ("six units each", "this filter RMS", "largest", "stated 1 σ", "in the 95 % ellipse", "VQF RMS"):
        table.add_column(column, justify="right")
    kinds = {
        "stands 3 s, walks 40 s": ([(3.0, 43.0)], 1.5),
        "stands 8 s, walks and stops": ([(8.0, 20.0), (24.0, 36.0), (39.0, 55.0)], 1.5),
        "walks from the start, 60 s": ([(-3.0, 80.0)], 6.0),
    }
    for name, (bouts_s, from_s) in kinds.items():
        tilts, covs, vqfs, covered = [], [], [], []
        for seed in range(6):
            motion = with_mpu6050_noise(
                hip_motion(bouts_s, 60.0, seed),
                seed,
                sf_bias_mps2=CALIBRATED.specific_force_mps2,
                scale=CALIBRATED.scale,
            )
            chosen = motion.t_ns > motion.t_ns[0] + round(1e9 * from_s)
            ours = estimate(motion.t_ns, motion.sf_B, motion.w_B, CALIBRATED)
            tilt = tilt_errors_W(ours.R_WB, motion.R_WB)[chosen]
            tilts.append(np.linalg.norm(tilt, axis=1))
            covs.append(ours.cov_W[chosen, 0, 0] + ours.cov_W[chosen, 1, 1])
            covered.append(coverage(tilt, ours.cov_W[chosen]))
            at_end = 0.5 * (motion.R_WB[:-1, 2, :] + motion.R_WB[1:, 2, :])
            chord = vqf_up_B(motion.sf_B, motion.w_B, 100.0)[:-1] - at_end
            vqfs.append(np.linalg.norm(chord[chosen[:-1]], axis=1))
        table.add_row(
            name,
            f"{rms_deg(np.array(tilts)):.2f}",
            f"{np.degrees(np.max(tilts)):.2f}",
            f"{np.degrees(np.sqrt(np.mean(covs))):.2f}",
            f"{100 * np.mean(covered):.0f} %",
            f"{rms_deg(np.array(vqfs)):.2f}",
        )
    console.print(table)


def foot_errors_rad(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Return the errors of this filter and of VQF on a walking foot, against gravity where the foot stands flat."""
    rows = np.loadtxt(folder / "short_walk.csv.gz", delimiter=",", skiprows=1)
    rows = rows[np.diff(rows[:, 0], prepend=-1.0) > 0.0]
    t_ns, w_B, sf_B = (
        np.round(1e9 * rows[:, 0]).astype(np.int64),
        np.radians(rows[:, 1:4]),
        STANDARD_GRAVITY_MPS2 * rows[:, 4:7],
    )
    flat = np.convolve(np.linalg.norm(w_B, axis=1) < np.radians(15.0), np.ones(41) / 41, "same") > 0.999
    sf_mean = np.stack([np.convolve(sf_B[:, i], np.ones(41) / 41, "same") for i in range(3)], axis=1)
    up_B = sf_mean / np.linalg.norm(sf_mean, axis=1, keepdims=True)
    ours = estimate(t_ns, sf_B, w_B, UNCALIBRATED).up_B
    peer = vqf_up_B(sf_B, w_B, 1e9 / float(np.median(np.diff(t_ns))))
    chosen = flat & ~np.isnan(ours[:, 0])
    return np.linalg.norm((ours - up_B)[chosen], axis=1), np.linalg.norm((peer - up_B)[chosen], axis=1)


def foot(console: Console) -> None:
    ours, peer = foot_errors_rad(shared_data("xio_foot_walk"))
    console.print(
        "A real foot walking 25 m, against gravity where it stands flat: "
        f"this filter {rms_deg(ours):.2f}°, VQF {rms_deg(peer):.2f}° RMS"
    )


def euroc_error_rad(folder: Path) -> FloatArray:
    """Return the error of this filter on a flight, at the times of the truth from the filter's start on."""
    imu = [line.split(",") for line in _lines(folder / "imu0.csv.gz")]
    truth = [line.split(",") for line in _lines(folder / "truth_recomputed_20hz.csv")]
    t_ns = np.array([int(row[0]) for row in imu])
    values = np.array([row[1:] for row in imu], dtype=np.float64)
    up_B = estimate(t_ns, values[:, 3:6], values[:, 0:3], Residual(specific_force_mps2=0.1, scale=0.005)).up_B
    index = np.clip(np.searchsorted(t_ns, [int(row[0]) for row in truth]), 0, len(t_ns) - 1)
    error = np.linalg.norm(up_B[index] - up_B_of(np.array([row[4:8] for row in truth], dtype=np.float64)), axis=1)
    return np.asarray(error[~np.isnan(error)], dtype=np.float64)


def euroc(console: Console) -> None:
    error_deg = rms_deg(euroc_error_rad(shared_data("euroc_v1_01_easy")))
    console.print(
        f"EuRoC V1_01, 70 s of flight: {error_deg:.2f}° RMS, of which 0.6° is the uncalibrated accelerometer's bias"
    )


def _lines(path: Path) -> list[str]:
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def main() -> int:
    console = Console(width=160)
    for section in (walks, broad, foot, euroc):
        _print_if_there(section, console)
    return 0


def _print_if_there(section: Callable[[Console], None], console: Console) -> None:
    try:
        section(console)
    except pytest.skip.Exception as absent:
        console.print(f"{section.__name__}: {absent}")


if __name__ == "__main__":
    sys.exit(main())
