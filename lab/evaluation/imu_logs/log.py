"""Logs of an IMU beside its true attitude: a folder of `NAME_imu.csv` and `NAME_truth.csv`, or of BROAD's trials.

    NAME_imu.csv     ns, angular rate x y z in rad/s, specific force x y z in m/s²; any rate
    NAME_truth.csv   ns, position x y z in m, quaternion w x y z body to world, z up; the clock is the IMU's
    NAME.npz         gyr, acc, opt_quat, opt_pos, movement, sampling_rate, as BROAD has them

Tables may be gzipped (.gz), lines that begin with # are comments.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.protocols import DeviceError
from drivers.recording.asl_folder import TruthTrack, read_truth
from drivers.recording.asl_tables import read_table
from messages.arrays import BoolArray, FloatArray, IntArray
from messages.errors import UserError
from systems.imu.broad import read_trial

FILTER_HZ = 100.0
"""The rate of the IMU that the filter is made for: faster logs are averaged in blocks to about this rate."""

_LEAST_S, _LEAST_HZ, _MOST_HZ = 20.0, 50.0, 10_000.0
_MOST_W_RADPS, _MEAN_SF_MPS2 = 90.0, (5.0, 20.0)


@dataclass(frozen=True)
class ImuLog:
    """sf_B (n, 3) m/s² and w_B (n, 3) rad/s at t_ns (n,), as logged; the truth and, for each of its m poses, whether it
    belongs to what is judged."""

    name: str
    t_ns: IntArray
    sf_B: FloatArray
    w_B: FloatArray
    truth: TruthTrack
    judged: BoolArray

    @property
    def rate_hz(self) -> float:
        """Return the rate of the samples."""
        return 1e9 / float(np.median(np.diff(self.t_ns)))

    def averaged(self) -> "ImuLog":
        """Return the log in means of so many samples that about FILTER_HZ are left, stamped at their middle."""
        block = max(1, round(self.rate_hz / FILTER_HZ))
        count = len(self.t_ns) // block * block
        t_ns = self.t_ns[:count].reshape(-1, block)
        middle_ns = t_ns[:, 0] + np.rint((t_ns - t_ns[:, :1]).mean(axis=1)).astype(np.int64)
        sf_B, w_B = (values[:count].reshape(-1, block, 3).mean(axis=1) for values in (self.sf_B, self.w_B))
        return ImuLog(self.name, middle_ns, sf_B, w_B, self.truth, self.judged)


def read_logs(folder: Path) -> Iterator[ImuLog]:
    """Yield the logs of `folder`, by name.

    Raises UserError, one line, where there is none, or one is not sound.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: is no folder")
    tables = [*sorted(folder.glob("*_imu.csv")), *sorted(folder.glob("*_imu.csv.gz"))]
    trials = sorted(folder.glob("*.npz"))
    if not tables and not trials:
        raise UserError(f"{folder}: no log: neither NAME_imu.csv (or .csv.gz) with NAME_truth.csv, nor NAME.npz")
    try:
        for path in tables:
            yield _checked(_of_tables(path), path)
        for path in trials:
            yield _checked(_of_trial(path), path)
    except DeviceError as error:
        raise UserError(str(error)) from error


def _of_tables(path: Path) -> ImuLog:
    name = path.name.removesuffix(".gz").removesuffix("_imu.csv")
    beside = [path.with_name(f"{name}_truth.csv{end}") for end in ("", ".gz")]
    found = [each for each in beside if each.is_file()]
    if not found:
        raise UserError(f"{path}: no truth beside it: neither {beside[0].name} nor {beside[1].name}")
    imu, truth = read_table(path, 6), read_truth(found[0])
    return ImuLog(name, imu.t_ns, imu.values[:, 3:], imu.values[:, :3], truth, np.ones(len(truth.t_ns), dtype=bool))


def _of_trial(path: Path) -> ImuLog:
    trial = read_trial(path)
    with np.load(path) as data:
        if "movement" not in data:
            raise UserError(f"{path}: array movement is missing")
        moves = np.asarray(data["movement"], dtype=bool)
    seen = np.isfinite(trial.q_WS).all(axis=1) & np.isfinite(trial.p_W_m).all(axis=1)
    t_ns = np.rint(1e9 * trial.t_s).astype(np.int64)
    truth = TruthTrack(t_ns[seen], trial.q_WS[seen], trial.p_W_m[seen])
    return ImuLog(path.stem, t_ns, trial.sf_mps2, trial.w_radps, truth, moves[seen])


def _checked(log: ImuLog, path: Path) -> ImuLog:
    """Return `log`; raises UserError where its numbers cannot be those of an IMU and its truth."""
    t_ns, truth_ns = log.t_ns, log.truth.t_ns
    seconds = 1e-9 * float(t_ns[-1] - t_ns[0])
    if seconds < _LEAST_S:
        raise UserError(f"{path}: lasts {seconds:.1f} s, allowed {_LEAST_S:g} s or more")
    if not _LEAST_HZ <= log.rate_hz <= _MOST_HZ:
        raise UserError(f"{path}: has {log.rate_hz:.1f} samples a second, allowed {_LEAST_HZ:g} to {_MOST_HZ:g}")
    most_w_radps = float(np.abs(log.w_B).max())
    if most_w_radps > _MOST_W_RADPS:
        raise UserError(f"{path}: an angular rate of {most_w_radps:.0f} rad/s, allowed up to {_MOST_W_RADPS:g}; °/s?")
    sf_mps2 = float(np.median(np.linalg.norm(log.sf_B, axis=1)))
    if not _MEAN_SF_MPS2[0] <= sf_mps2 <= _MEAN_SF_MPS2[1]:
        raise UserError(
            f"{path}: a specific force of {sf_mps2:.2f} m/s² at the median, "
            f"allowed {_MEAN_SF_MPS2[0]:g} to {_MEAN_SF_MPS2[1]:g}; in g, or without gravity?"
        )
    overlap_s = 1e-9 * float(min(t_ns[-1], truth_ns[-1]) - max(t_ns[0], truth_ns[0])) if len(truth_ns) else 0.0
    if overlap_s < 0.5 * _LEAST_S:
        raise UserError(f"{path}: overlaps its truth for {overlap_s:.1f} s, allowed {0.5 * _LEAST_S:g} s or more")
    return log
