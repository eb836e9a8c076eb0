"""A recording as a table: columns of numbers by name, one of them the time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from discrepancy.simulation import Channels
from impedance.recording.table import header_of, read_columns
from messages.arrays import FloatArray
from messages.errors import UserError, unknown_name

_UNEVEN = 0.01
"""Of a time step: by how much it may differ from the others."""


@dataclass(frozen=True)
class Table:
    """The columns of a file, `table["angle_rad"]` (n,); to ask for one that it has not raises UserError."""

    path: Path
    columns: dict[str, FloatArray]

    @staticmethod
    def load(path: Path | str) -> "Table":
        """Read a CSV file, which may be gzipped: names in its first row, numbers below; raises UserError, one line."""
        path = Path(path)
        names = [name for name in header_of(path) if name]
        values = read_columns(path, names)
        return Table(path, dict(zip(names, values.T, strict=True)))

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column (n,); raises UserError, naming the nearest, where there is no such one."""
        if name not in self.columns:
            raise unknown_name(f"{self.path}: column {name}", name, self.columns)
        return self.columns[name]

    def thinned(self, by: int) -> "Table":
        """Return the table with each `by` rows as one, their mean; raises UserError where `by` is below 1."""
        if by < 1:
            raise UserError(f"{self.path}: thinned by {by}; expected 1 or more")
        rows = {
            name: column[: len(column) // by * by].reshape(-1, by).mean(axis=1) for name, column in self.columns.items()
        }
        return Table(self.path, rows)

    def rows(self, first: int, last: int) -> "Table":
        """Return the rows from `first` on, before `last`."""
        return Table(self.path, {name: column[first:last] for name, column in self.columns.items()})

    def channels(
        self,
        measured: Sequence[str],
        inputs: Sequence[str] = (),
        *,
        time: str = "t_s",
        possible: Mapping[str, tuple[float, float]] | None = None,
    ) -> Channels:
        """Return the columns `measured` and the `inputs` as the finder takes them.

        `possible` are the least and greatest value that the thing itself can take, by column, such as a motor's peak
        torque. Raises UserError, naming file and column, where one is missing, an input has no number, a value is not
        possible, or the times in `time`, in seconds, are not evenly spaced.
        """
        for name, (low, high) in (possible or {}).items():
            beyond = (self[name] < low) | (self[name] > high)
            if beyond.any():
                raise UserError(
                    f"{self.path}: {name}: {100.0 * beyond.mean():.2g} % of the rows are impossible, from "
                    f"{np.nanmin(self[name]):.4g} to {np.nanmax(self[name]):.4g}; expected {low:.4g} to {high:.4g}"
                )
        t_s = self[time]
        steps = np.diff(t_s)
        if not (len(steps) and np.isfinite(t_s).all() and steps.min() > 0.0):
            raise UserError(f"{self.path}: {time}: expected times that increase from row to row")
        if steps.max() - steps.min() > _UNEVEN * steps.mean():
            at = int(np.argmax(np.abs(steps - np.median(steps)))) + 2
            raise UserError(
                f"{self.path}: {time}: row {at} is {steps[at - 2]:.6g} s before the next, others "
                f"{np.median(steps):.6g} s; expected evenly spaced times (interpolate first)"
            )
        for name in inputs:
            if not np.isfinite(self[name]).all():
                raise UserError(f"{self.path}: {name}: row {int(np.argmax(~np.isfinite(self[name]))) + 2} is no number")
        return Channels(t_s, self._stacked(measured), tuple(measured), self._stacked(inputs), tuple(inputs))

    def _stacked(self, names: Sequence[str]) -> FloatArray:
        length = len(next(iter(self.columns.values())))
        return np.column_stack([self[name] for name in names]) if names else np.zeros((length, 0))
