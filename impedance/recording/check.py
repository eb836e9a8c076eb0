"""What is wrong with a recording, found from the recording itself: stamps, gaps, missing samples, rates.

Each finding is one line. What can be lived with is a note (gaps, NaN, unequal rates); what cannot is a UserError. Units
and axes follow in impedance.recording.axes.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from impedance.recording.axes import check_axes, check_units
from impedance.recording.resampling import resampled
from messages.arrays import FloatArray
from messages.errors import UserError

_RATE_TOLERANCE: Final = 1e-3
_STAMP_TOLERANCE: Final = 0.3
"""Of a sample period: how far a stamp may lie off the grid."""
_MOST_MISSING: Final = 0.5
LEAST_S: Final = 1.0
_LEAST_ROWS: Final = 20
_LARGEST: Final = 1e12


@dataclass(frozen=True)
class Stream:
    """`values` (n, c) called `columns`, at `t_s` (n,); `where` names the file."""

    where: str
    columns: tuple[str, ...]
    t_s: FloatArray
    values: FloatArray

    @property
    def rate_hz(self) -> float:
        """Return the samples per second of a uniform stream."""
        return float((len(self.t_s) - 1) / (self.t_s[-1] - self.t_s[0]))


def on_grid(stream: Stream, rate_hz: float, setting: str) -> tuple[Stream, tuple[str, ...]]:
    """Return the stream on the uniform grid of its stamps, NaN where a sample is missing, and notes on that.

    Raises UserError where stamps do not increase, where they run at another rate than `rate_hz`, called `setting`, or
    where more than half of the samples are missing.
    """
    t_s, where = stream.t_s, stream.where
    if len(t_s) < _LEAST_ROWS:
        raise UserError(f"{where}: holds {len(t_s)} samples, allowed {_LEAST_ROWS} or more")
    if not np.isfinite(t_s).all():
        raise UserError(f"{where}: row {_row(~np.isfinite(t_s))}: t_s is not a number")
    _check_size(where, ("t_s", *stream.columns), np.column_stack((t_s, stream.values)))
    steps_s = np.diff(t_s)
    if not (steps_s > 0.0).all():
        raise UserError(f"{where}: row {_row(steps_s <= 0.0) + 1}: t_s does not increase")
    if t_s[-1] - t_s[0] < LEAST_S:
        raise UserError(f"{where}: lasts {t_s[-1] - t_s[0]:.3g} s, allowed {LEAST_S:g} s or more")
    median_hz = 1.0 / float(np.median(steps_s))
    if abs(median_hz / rate_hz - 1.0) > 0.5 * _STAMP_TOLERANCE:
        raise UserError(f"{where}: its stamps run at {median_hz:.5g} Hz, {setting} is {rate_hz:g}: unequal rates")
    index = np.concatenate(([0], np.cumsum(np.rint(steps_s * rate_hz)))).astype(np.int64)
    _check_missing(where, 1.0 - len(t_s) / float(index[-1] + 1))
    if len(np.unique(index)) < len(index):
        raise UserError(
            f"{where}: row {_row(np.diff(index) == 0) + 1}: t_s is less than half a sample after the row before"
        )
    period_s, start_s = np.polyfit(index, t_s, 1)
    if abs(rate_hz * period_s - 1.0) > _RATE_TOLERANCE:
        raise UserError(f"{where}: its stamps run at {1.0 / period_s:.6g} Hz, {setting} is {rate_hz:g}: unequal rates")
    off = np.abs(t_s - start_s - period_s * index) / period_s
    if off.max() > _STAMP_TOLERANCE:
        raise UserError(
            f"{where}: row {int(off.argmax()) + 2}: t_s lies {off.max():.2f} samples off the grid of {setting}"
        )
    values = np.full((int(index[-1]) + 1, stream.values.shape[1]), np.nan)
    values[index] = np.where(np.isfinite(stream.values), stream.values, np.nan)
    grid = replace(stream, t_s=start_s + period_s * np.arange(len(values)), values=values)
    return grid, _missing(grid, index)


def prepared(
    motion: Stream,
    force: Stream,
    *,
    plate_mass_kg: float,
    joint_to_surface_m: float,
    foot_in_plate_m: FloatArray | None,
) -> tuple[str, ...]:
    """Check two uniform streams against each other; return notes.

    Raises UserError for streams that hardly overlap, for a wrong unit and for swapped or reversed axes.
    """
    overlap_s = min(motion.t_s[-1], force.t_s[-1]) - max(motion.t_s[0], force.t_s[0])
    if overlap_s < LEAST_S:
        raise UserError(f"{force.where}: overlaps {motion.where} by {overlap_s:.3g} s, allowed {LEAST_S:g} s or more")
    check_units(motion.where, motion.values, joint_to_surface_m, foot_in_plate_m)
    wrench = resampled(force.t_s, force.values, motion.t_s)
    check_axes(
        (motion.where, force.where), motion.rate_hz, motion.values[:, :6], wrench, joint_to_surface_m, plate_mass_kg
    )
    if abs(force.rate_hz / motion.rate_hz - 1.0) > _RATE_TOLERANCE:
        return (f"{force.where}: {force.rate_hz:.5g} Hz, the motion {motion.rate_hz:.5g} Hz: unequal rates, resampled",)
    return ()


def _missing(grid: Stream, index: np.ndarray[tuple[int], np.dtype[np.int64]]) -> tuple[str, ...]:
    """Return a note on gaps and one on each column's NaN; raises UserError where too much is missing."""
    absent = np.ones(len(grid.t_s), dtype=bool)
    absent[index] = False
    bad = ~np.isfinite(grid.values)
    _check_missing(grid.where, float(bad.any(axis=1).mean()))
    notes = []
    if absent.any():
        runs = _runs(absent)
        longest = max(runs, key=lambda run: run[1] - run[0])
        notes.append(
            f"{grid.where}: {_count(len(runs), 'gap')}, {_count(int(absent.sum()), 'sample')} missing, the longest "
            f"from {grid.t_s[longest[0]]:.3f} to {grid.t_s[longest[1] - 1]:.3f} s: left out"
        )
    for name, column in zip(grid.columns, (bad & ~absent[:, None]).T, strict=True):
        if column.any():
            first_s = grid.t_s[np.argmax(column)]
            notes.append(
                f"{grid.where}: {name} is NaN in {_count(int(column.sum()), 'row')}, first at {first_s:.3f} s: left out"
            )
    return tuple(notes)


def _check_size(where: str, columns: tuple[str, ...], values: FloatArray) -> None:
    """Refuse what is no quantity of a laboratory and whose square overflows."""
    too_large = np.isfinite(values) & (np.abs(values) > _LARGEST)
    if too_large.any():
        row, column = np.argwhere(too_large)[0]
        raise UserError(
            f"{where}: row {row + 2}: {columns[column]} is {values[row, column]:.3g}, allowed up to {_LARGEST:g}"
        )


def _check_missing(where: str, share: float) -> None:
    if share > _MOST_MISSING:
        raise UserError(
            f"{where}: {100.0 * share:.0f} % of the samples are missing, allowed {100.0 * _MOST_MISSING:.0f} %"
        )


def _runs(flags: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")


def _row(flags: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> int:
    """Return the row of the file, its header being row 1, of the first flag."""
    return int(np.argmax(flags)) + 2
