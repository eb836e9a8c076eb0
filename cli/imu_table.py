"""The IMU's samples of a replay as the table that `gaiteyes explain imu` reads beside a laboratory's reference."""

from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np

from impedance.recording.table import write_columns
from messages import Estimate, ImuSample, Input, UserError
from systems.imu.recording import IMU_COLUMNS, IMU_FILE, TEMPERATURE_COLUMN

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


class ImuTable:
    """Collects samples, in nominal scale, and writes them at the end; `t_s` counts from the first.

    `utc_offset_ns` is UTC less the clock of the samples, None where it is not known. Raises UserError, in one line,
    where `folder` cannot be written.
    """

    def __init__(self, folder: Path, utc_offset_ns: int | None) -> None:
        self.path = folder / IMU_FILE
        self._utc_offset_ns = utc_offset_ns
        self._rows: list[tuple[float, ...]] = []
        self._first_ns: int | None = None

    @property
    def start_utc(self) -> str | None:
        """Return the UTC of `t_s` = 0, to the microsecond; None where it is not known."""
        if self._utc_offset_ns is None or self._first_ns is None:
            return None
        return (_EPOCH + timedelta(microseconds=(self._first_ns + self._utc_offset_ns) // 1000)).isoformat()

    def add_input(self, message: Input) -> None:
        """Take one input."""
        if isinstance(message, ImuSample):
            self._first_ns = message.t_sample_ns if self._first_ns is None else self._first_ns
            t_s = 1e-9 * (message.t_sample_ns - self._first_ns)
            self._rows.append((t_s, *message.w_WB_B_radps, *message.sf_B_mps2, message.temperature_degC))

    def add_estimate(self, _estimate: Estimate) -> None:
        """Do nothing: the table holds what was measured."""

    def close(self) -> None:
        """Write the table. Raises UserError where that cannot be done, or there was no sample."""
        if not self._rows:
            raise UserError(f"{self.path}: nothing to write: the source holds no IMU sample")
        write_columns(self.path, (*IMU_COLUMNS, TEMPERATURE_COLUMN), np.array(self._rows))
