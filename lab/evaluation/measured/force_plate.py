"""Two force plates of an instrumented treadmill at rest for a minute, and how well a noise model predicts them."""

import gzip
from pathlib import Path

import numpy as np

from impedance.recording.force_noise import ChannelNoise
from messages.arrays import FloatArray

PLATES = ("FP1", "FP2")
WRENCH = ("ForX", "ForY", "ForZ", "MomX", "MomY", "MomZ")


def resting_plates(folder: Path) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the stamps (n,) and each plate's wrench (n, 6) in N and N·m."""
    with gzip.open(folder / "stationary_60s.csv.gz", "rt", encoding="utf-8") as file:
        header = file.readline().strip().split(",")
        values = np.loadtxt(file, delimiter=",", usecols=range(13))
    columns = {plate: [header.index(f"{plate}.{name}") for name in WRENCH] for plate in PLATES}
    return values[:, 0], {plate: values[:, places] for plate, places in columns.items()}


def innovation_ratio(channel: ChannelNoise, y: FloatArray) -> float:
    """Return how large another record's innovations are, in units of the model's."""
    white = channel.innovations(y - y.mean())[len(channel.autoregression) :]
    return float(white.std() / channel.innovation)
