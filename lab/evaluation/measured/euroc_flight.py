"""EuRoC V1_01: an IMU on a flying vehicle, 70 s, with the recomputed truth."""

import gzip
from pathlib import Path

import numpy as np

from lab.evaluation.attitude import estimate, up_B_of
from messages import Residual
from messages.arrays import FloatArray


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


def _lines(path: Path) -> list[str]:
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    return [line for line in text.splitlines() if line and not line.startswith("#")]
