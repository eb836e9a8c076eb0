"""Inclination of this project's filter beside VQF, Mahony and Madgwick: `python -m benchmarks.attitude`.

Every filter runs with one set of parameters on all data of its column. This one's are tuned on half of BROAD's trials
and on made-up walks; VQF's defaults are at its optimum there; of the other two, the set published with BROAD and one
tuned on the same half are shown. Mahony and Madgwick are given the gyroscope's bias of the first second.
"""

import sys
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.attitude_peers import Madgwick, Mahony, attitudes
from lab.evaluation.attitude import (
    CALIBRATED,
    UNCALIBRATED,
    coverage,
    estimate,
    rms_deg,
    tilt_errors_W,
    tilt_of_up_W,
    up_B_of,
    vqf_up_B,
)
from lab.evaluation.hip_motion import hip_motion, with_mpu6050_noise
from lab.evaluation.measured.broad import HELD_OUT, TUNING, Trial, trials
from lab.evaluation.measured.data_folder import data_folder
from lab.evaluation.measured.euroc_flight import euroc_error_rad
from lab.evaluation.measured.foot_walk import foot_errors_rad
from messages.arrays import FloatArray
from messages.errors import UserError

_HALF_SAMPLE = 0.5


def broad(console: Console) -> None:
    data = trials(data_folder("broad"))
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


def foot(console: Console) -> None:
    ours, peer = foot_errors_rad(data_folder("xio_foot_walk"))
    console.print(
        "A real foot walking 25 m, against gravity where it stands flat: "
        f"this filter {rms_deg(ours):.2f}°, VQF {rms_deg(peer):.2f}° RMS"
    )


def euroc(console: Console) -> None:
    error_deg = rms_deg(euroc_error_rad(data_folder("euroc_v1_01_easy")))
    console.print(
        f"EuRoC V1_01, 70 s of flight: {error_deg:.2f}° RMS, of which 0.6° is the uncalibrated accelerometer's bias"
    )


def main() -> int:
    console = Console(width=160)
    for section in (walks, broad, foot, euroc):
        _print_if_there(section, console)
    return 0


def _print_if_there(section: Callable[[Console], None], console: Console) -> None:
    try:
        section(console)
    except UserError as absent:
        console.print(f"{section.__name__}: {absent}")


if __name__ == "__main__":
    sys.exit(main())
