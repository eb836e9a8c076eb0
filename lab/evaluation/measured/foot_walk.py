"""A real foot that walks 25 m with an IMU (x-io): whoever says its attitude is judged where the foot stands flat."""

from pathlib import Path

import numpy as np

from lab.evaluation.attitude import UNCALIBRATED, estimate, vqf_up_B
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2


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
