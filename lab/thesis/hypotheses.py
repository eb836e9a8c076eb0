"""The printed tables under a hypothesis: its causes, simulated, through the study's own estimator, once per size.

A hypothesis is a set of causes with their sizes. Runs are simulated once and kept in a folder, and so is every column
that was estimated: what was begun can be ended another day.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import get_context
from os import getpid
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia
from impedance.recording.recording import Poses
from impedance.thesis.estimator import (
    LinearResidual,
    Variant,
    foot_residual,
    least_residual,
    plate_residual,
)
from lab.thesis.causes import ALIASING, CAUSES, changed
from lab.thesis.printed import FOOT, PLATE, RATES_HZ, ROWS, rows_of
from lab.thesis.signals import Signals
from messages.arrays import FloatArray, rms
from messages.errors import UserError
from sim_rig.platform import rig
from sim_rig.platform.run import RunSettings, SimulatedRun, simulate

EVERY: Final = 4  # of the residual's samples: 87.5 a second hold what is left below 40 Hz
PLATE_ROWS: Final = ROWS[1:]  # its mass was weighed, not estimated, and is printed thrice alike
CELLS: Final = (*(f"plate {name}" for name in PLATE_ROWS), *(f"foot {name}" for name in ROWS))
FOOT_AT: Final = len(PLATE_ROWS)
PINNED: Final = FOOT_AT + ROWS.index("Jx")
_TWIN: Final = FOOT_AT + ROWS.index("Jz")
_RESOLUTION: Final = np.array([*(0.1,) * 9, 0.01, *(0.1,) * 9])  # of the printed figures
FIT: Final = (0, 1)  # of RATES_HZ: 29 and 40 Hz tell the sizes
TEST: Final = 2  # 67 Hz is predicted
MOST_TOLERANCES: Final = 3.0  # by which a cell may be missed

Sizes = Mapping[str, float]
"""A hypothesis: causes by name with their sizes."""


def printed_cells() -> FloatArray:
    """Return the experiments' columns of both tables, (3 rates, 19 cells)."""
    return np.hstack((np.array(PLATE.experiment)[:, 1:], np.array(FOOT.experiment)))


def tolerances() -> FloatArray:
    """Return each cell's tolerance (19,): the spread of its three runs, and the rounding of what is printed.

    tol² = s² + Δ² / 12, s the standard deviation over the three runs, Δ the last digit's unit. The foot's Jx is printed
    as 0.0 three times; a value held at a bound tells no spread, so it gets that of Jz, its twin in size and on the
    ridge of J and y0.
    """
    spread = printed_cells().std(axis=0, ddof=1)
    spread[PINNED] = spread[_TWIN]
    tolerance: FloatArray = np.sqrt(spread**2 + _RESOLUTION**2 / 12.0)
    return tolerance


class Columns(msgspec.Struct, frozen=True):
    """What the estimator finds, (3 rates, 19 cells) in the tables' units: `free`, or with no moment below zero."""

    free: list[list[float]]
    bounded: list[list[float]]

    def cells(self, bounded: bool) -> FloatArray:
        """Return one of both."""
        return np.array(self.bounded if bounded else self.free)


@dataclass(frozen=True)
class Study:
    """Three runs of the bare plate and three with the foot of `seconds` each, drawn by `seed`, kept in `folder`."""

    folder: Path
    seed: int
    seconds: float

    def prepare(self) -> None:
        """Make the folder. Raises UserError where it cannot be made, or holds another study."""
        text = f"seed {self.seed}, {self.seconds:g} s, every {EVERY}. sample\n"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            stamp = self.folder / "study.txt"
            if stamp.exists() and stamp.read_text() != text:
                raise UserError(f"{stamp}: {stamp.read_text().strip()}, but asked for {text.strip()}: another folder")
            stamp.write_text(text)
        except OSError as error:
            raise UserError(f"--out {self.folder}: {error.strerror}") from error

    def columns(self, sizes: Sizes) -> Columns:
        """Return what the estimator finds under a hypothesis, from the folder where it was estimated before."""
        path = self._path(sizes)
        if path.exists():
            return msgspec.json.decode(path.read_bytes(), type=Columns)
        both = [self._estimated(hz, sizes) for hz in RATES_HZ]
        found = Columns(*(np.array([pair[k] for pair in both]).tolist() for k in (0, 1)))
        path.with_suffix(".part").write_bytes(msgspec.json.encode(found))
        path.with_suffix(".part").replace(path)
        return found

    def holds(self, sizes: Sizes) -> bool:
        """Tell whether a hypothesis was estimated before."""
        return self._path(sizes).exists()

    def _path(self, sizes: Sizes) -> Path:
        text = "; ".join(f"{name} = {sizes[name]!r}" for name in sorted(sizes))
        return self.folder / f"columns_{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"

    def _estimated(self, hz: int, sizes: Sizes) -> tuple[FloatArray, FloatArray]:
        raw = sizes.get(ALIASING, 0.0) > 0.0
        bare, loaded = (changed(_signals(self, hz, foot, raw), sizes).recorded for foot in (False, True))
        plate = least_residual(_thinned(plate_residual(bare, Variant())), rig.PLATE.mass_kg, moments_bounded=False)
        residual = _thinned(foot_residual(loaded, plate, Variant()))
        free = least_residual(residual, None, moments_bounded=False)
        below_zero = np.diag(free.inertia_kgm2).min() < 0.0
        bounded = least_residual(residual, None, moments_bounded=True) if below_zero else free
        return _cells(plate, free), _cells(plate, bounded)


def estimate_all(study: Study, hypotheses: Iterable[Sizes], processes: int) -> Iterable[Sizes]:
    """Estimate every hypothesis that the folder does not hold, in so many processes; yield each when it is done."""
    wanted = [dict(sizes) for sizes in hypotheses]
    if processes == 1:
        for sizes in wanted:
            study.columns(sizes)
            yield sizes
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_estimated_in_folder, [study] * len(wanted), wanted, chunksize=2)


def _estimated_in_folder(study: Study, sizes: Sizes) -> Sizes:
    study.columns(sizes)
    return sizes


def _cells(plate: Inertia, foot: Inertia) -> FloatArray:
    return np.concatenate((rows_of(plate)[1:], rows_of(foot)))


def _thinned(residual: LinearResidual) -> LinearResidual:
    return LinearResidual(residual.columns[::EVERY], residual.wrench[::EVERY], residual.transport)


@lru_cache(maxsize=12)
def _signals(study: Study, hz: int, foot: bool, raw: bool) -> Signals:
    """Return a run: simulated once, then kept in the folder and in memory."""
    settings = RunSettings(
        rig=rig.Rig(foot=rig.FOOT if foot else None), update_hz=float(hz), duration_s=study.seconds, raw=raw
    )
    steps, noise = np.random.SeedSequence((study.seed, hz, foot)).generate_state(2).tolist()
    path = study.folder / f"run_{hz}_{'foot' if foot else 'plate'}{'_raw' if raw else ''}.npz"
    if not path.exists():
        _keep(path, simulate(settings, steps))
    with np.load(path) as kept:
        foot_poses = Poses.from_columns(kept["foot"]) if foot else None
        run = SimulatedRun(
            settings=settings,
            seed=steps,
            t_s=kept["t_s"],
            angles_rad=kept["angles_rad"],
            plate=Poses.from_columns(kept["plate"]),
            foot=foot_poses,
            wrench=kept["wrench"],
            kinematics=Kinematics(*kept["kinematics"]),
        )
    return Signals.of_run(run, noise)


def _keep(path: Path, run: SimulatedRun) -> None:
    k = run.kinematics
    part = path.with_name(f"part_{getpid()}_{path.name}")  # each process its own: two may make the same run at once
    np.savez(
        part,
        t_s=run.t_s,
        angles_rad=run.angles_rad,
        plate=run.plate.columns,
        foot=np.empty(0) if run.foot is None else run.foot.columns,
        wrench=run.wrench,
        kinematics=np.stack((k.a_O_P, k.w, k.alpha, k.g_P)),
    )
    part.replace(path)


@dataclass(frozen=True)
class Misfit:
    """How far a hypothesis is from the printed columns, in tolerances: z (3 rates, 19 cells)."""

    z: FloatArray
    pinned: bool

    @classmethod
    def of(cls, cells: FloatArray) -> "Misfit":
        """Return the misfit of estimated or interpolated `cells` (3, 19)."""
        z = (cells - printed_cells()) / tolerances()
        at_zero = np.abs(cells[:, PINNED]) < 0.5 * _RESOLUTION[PINNED]
        return cls(z, bool(at_zero.all()))

    @property
    def fit(self) -> float:
        """Return the RMS over both tables at 29 and 40 Hz: what sizes are fitted by."""
        return rms(self.z[list(FIT)])

    @property
    def foot_fit(self) -> float:
        """Return the RMS over the foot at 29 and 40 Hz."""
        return rms(self.z[list(FIT), FOOT_AT:])

    @property
    def foot_test(self) -> float:
        """Return the RMS over the foot at 67 Hz, which no size was fitted to."""
        return rms(self.z[TEST, FOOT_AT:])

    @property
    def plate(self) -> float:
        """Return the RMS over the plate at all rates."""
        return rms(self.z[:, :FOOT_AT])

    @property
    def missed(self) -> list[str]:
        """Return the cells that are missed by more than MOST_TOLERANCES at any rate, the worst first."""
        worst = np.abs(self.z).max(axis=0)
        return [CELLS[k] for k in np.argsort(-worst) if worst[k] > MOST_TOLERANCES]

    @property
    def reproduces(self) -> bool:
        """Tell whether every cell of both tables is met at all rates and the foot's Jx is printed as 0.0 each time."""
        return self.pinned and not self.missed


def first_hypotheses(names: Sequence[str]) -> list[dict[str, float]]:
    """Return the base and every knot of every cause: what the curves are drawn through."""
    knots = [{name: size} for name in names for size in CAUSES[name].knots if size != CAUSES[name].neutral]
    return [{}, *knots]
