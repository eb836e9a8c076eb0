"""The attitude after an outage of the IMU: `python -m benchmarks.outage [--seeds 31-38]`.

The rig's wearer walks on level ground, ramps and stairs, or stands, with the real driver on the simulated chip. Its
samples go missing for a while at many phases of the stride; what the filter then says is judged from its first VALID
on for three seconds. `restart` is a filter that knows nothing but the calibration, as after `AttitudeTrack.roll_back`.
"""

import argparse
import copy
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from lab.evaluation.attitude import coverage, tilt_errors_W
from lab.evaluation.hip_motion import Motion
from messages import ImuSample, Residual, Status
from messages.arrays import FloatArray, rms
from perception.attitude.filter import AttitudeFilter, AttitudeSettings
from perception.attitude.imu_model import corrected
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.imu.simulated_clock import SimulatedClock
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

OUTAGES_S = (0.05, 0.1, 0.2, 0.35, 0.5, 1.0, 2.0, 5.0, 10.0)
RESTART_S = np.inf
_WALKS = ("level", "ramps", "mixed")
_SECONDS, _FIRST_S, _JUDGED_S, _PATIENCE_S = 45.0, 5.0, 3.0, 8.0
_OUTAGES_A_WALK = 8
_BOOT_NS, _POWER_ON_NS = 1_000_000_000_000, 1_000_500_000_000
_ADDRESS, _POLL_S = 0x68, 0.005


@dataclass(frozen=True)
class Recovery:
    """Seconds until VALID, infinite if never; then tilt errors (n, 2), rad, and stated covariances (n, 3, 3)."""

    valid_after_s: float
    tilt_W: FloatArray
    cov_W: FloatArray


def rig_motion(seed: int, scenario_name: str, seconds: float) -> tuple[Motion, Residual]:
    """Return the calibrated samples of one rig wearer's IMU with their truth, and what its calibration left behind."""
    wearer = SimulatedWearer(seed, scenario(scenario_name), _POWER_ON_NS)
    samples = polled(wearer, seed, seconds)
    t_ns = np.array([sample.t_sample_ns for sample in samples])
    calibrated = [corrected(sample, wearer.calibration.imu) for sample in samples]
    sf_B, w_B = np.array([imu.sf_B_mps2 for imu in calibrated]), np.array([imu.w_WB_B_radps for imu in calibrated])
    return Motion(t_ns, sf_B, w_B, wearer.gait.at(t_ns).R_WB), wearer.calibration.residual


def polled(wearer: SimulatedWearer, seed: int, seconds: float) -> list[ImuSample]:
    """Return what the driver reads in simulated time, polling every 5 ms, late by 1 ms and now and then by 10 ms."""
    clock, rng = SimulatedClock(_BOOT_NS), np.random.default_rng(seed)
    chip = Mpu6050Chip(wearer.gait.imu, wearer.unit.chip, clock, seed)
    wires = I2cWires({_ADDRESS: chip}, elapse=clock.sleep)
    imu = Mpu6050(wires.open, address=_ADDRESS, settings=Mpu6050Settings(), clock=clock, sleep=clock.sleep)
    imu.open()
    start_ns = clock()
    samples: list[ImuSample] = []
    for due_s in np.arange(0.0, seconds, _POLL_S):
        late_s = rng.exponential(0.001) + 0.010 * (rng.random() < 0.005)
        clock.advance_to(start_ns + round(1e9 * (due_s + late_s)))
        samples += imu.read(timeout_s=0.0)
    return samples


def feed(attitude: AttitudeFilter, motion: Motion, index: int) -> None:
    """Give the filter one sample of `motion`."""
    x, y, z = motion.sf_B[index].tolist()
    p, q, r = motion.w_B[index].tolist()
    attitude.update(int(motion.t_ns[index]), (x, y, z), (p, q, r))


def recoveries(motion: Motion, residual: Residual, outage_s: float, rng: np.random.Generator) -> Iterator[Recovery]:
    """Yield what follows `_OUTAGES_A_WALK` outages, each of them the only one."""
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    missing_s = outage_s if np.isfinite(outage_s) else 0.0
    starts_s = np.sort(rng.uniform(_FIRST_S, t_s[-1] - missing_s - _JUDGED_S - 2.0, _OUTAGES_A_WALK))
    attitude, fed = AttitudeFilter(AttitudeSettings(), residual), 0
    for start in np.searchsorted(t_s, starts_s).tolist():
        while fed < start:
            feed(attitude, motion, fed)
            fed += 1
        after = AttitudeFilter(AttitudeSettings(), residual) if missing_s == 0.0 else copy.deepcopy(attitude)
        yield _recovery(after, motion.of(t_s >= t_s[start - 1] + missing_s))


def _recovery(attitude: AttitudeFilter, motion: Motion) -> Recovery:
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    valid_after_s = np.inf
    chosen: list[int] = []
    R_WB, cov_W = [], []
    for index in range(len(t_s)):
        if t_s[index] > min(_PATIENCE_S, valid_after_s) + _JUDGED_S:
            break
        feed(attitude, motion, index)
        if attitude.status is Status.VALID:
            valid_after_s = min(valid_after_s, float(t_s[index]))
            chosen.append(index)
            R_WB.append(attitude.R_WB)
            cov_W.append(attitude.rotation_cov_W)
    tilt_W = tilt_errors_W(np.array(R_WB).reshape(-1, 3, 3), motion.R_WB[chosen])
    return Recovery(valid_after_s, tilt_W, np.array(cov_W).reshape(-1, 3, 3))


def row(recovered: list[Recovery]) -> list[str]:
    """Return the columns of the table that judge `recovered`."""
    waits_s = [each.valid_after_s for each in recovered]
    tilt_W, cov_W = np.concatenate([each.tilt_W for each in recovered]), np.concatenate([r.cov_W for r in recovered])
    error_deg = np.degrees(np.linalg.norm(tilt_W, axis=1))
    squares = np.einsum("ni,nij,nj->n", tilt_W, np.linalg.inv(cov_W[:, :2, :2]), tilt_W)
    wrong = int(np.sum((squares > 16.0) & (error_deg > 3.0)))
    return [
        f"{len(recovered)}",
        f"{np.median(waits_s):.2f}",
        f"{np.max(waits_s):.2f}",
        f"{rms(error_deg):.2f}",
        f"{error_deg.max():.2f}",
        f"{np.degrees(np.sqrt(np.mean(cov_W[:, 0, 0] + cov_W[:, 1, 1]))):.2f}",
        f"{100.0 * coverage(tilt_W, cov_W):.1f} %",
        f"{np.sqrt(squares.max()):.1f}",
        f"{wrong}",
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description="The attitude after an outage of the IMU, on the rig.")
    parser.add_argument("--seeds", default="31-38", help="rig units, first-last")
    first, last = map(int, parser.parse_args().seeds.split("-"))
    table = Table(title="After an outage: seconds until VALID; tilt error in the 3 s from then on, degrees")
    for column in ("", "outage s", "n", "p50 s", "max s", "RMS", "max", "stated", "in 95 %", "most σ", "> 4 σ and 3°"):
        table.add_column(column, justify="right")
    for title, names in (("walking", _WALKS), ("standing", ("standing",))):
        walks = [rig_motion(seed, name, _SECONDS) for seed in range(first, last + 1) for name in names]
        for outage_s in (*OUTAGES_S, RESTART_S):
            rng = np.random.default_rng(round(1e3 * min(outage_s, 100.0)))
            recovered = [each for walk in walks for each in recoveries(*walk, outage_s, rng)]
            table.add_row(title, f"{outage_s:g}" if np.isfinite(outage_s) else "restart", *row(recovered))
        table.add_section()
    Console(width=120).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
