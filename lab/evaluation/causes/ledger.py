"""Errors of the ground, frame by frame, as measured and with one cause after another replaced by the truth.

What a cause adds is told twice: by what is left without it, and by how far its replacement moves the estimates.
Errors of several causes cancel in single units, so the parts need not add up to the whole.
"""

from collections import defaultdict

import msgspec
import numpy as np

from messages.arrays import FloatArray, column_rms

AS_MEASURED = "as measured"


class SlopeError(msgspec.Struct, frozen=True):
    """Estimate less truth of one frame: slope ahead and across in rad, height in m."""

    sagittal_rad: float
    frontal_rad: float
    height_m: float

    @property
    def slopes(self) -> FloatArray:
        """Return the errors ahead and across, (2,)."""
        return np.array((self.sagittal_rad, self.frontal_rad))

    def less(self, slopes: FloatArray) -> "SlopeError":
        """Return the error without `slopes` (2,)."""
        ahead, across = (self.slopes - slopes).tolist()
        return SlopeError(ahead, across, self.height_m)


class CauseScore(msgspec.Struct, frozen=True, kw_only=True):
    """One cause. `left_*` are RMS errors without it, `part_*` the RMS of the differences that it makes; NaN without
    frames."""

    name: str
    replaced_by: str
    frames: int
    left_sagittal_deg: float
    left_frontal_deg: float
    left_height_mm: float
    part_sagittal_deg: float
    part_frontal_deg: float
    part_height_mm: float


class Ledger:
    """Collects errors by variant, a variant for each cause and one as measured; frames go by any name of their own."""

    def __init__(self, replaced_by: dict[str, str]) -> None:
        """Take what stands in for each cause, by the cause's name."""
        self._replaced_by = replaced_by
        self._errors: dict[str, dict[object, SlopeError]] = defaultdict(dict)

    def add(self, variant: str, frame: object, error: SlopeError) -> None:
        """Take the error of one frame in one variant: a cause's name, or AS_MEASURED."""
        self._errors[variant][frame] = error

    def scores(self) -> list[CauseScore]:
        """Return the whole error first, and then that of each cause met, each over the frames that both have."""
        measured = self._errors[AS_MEASURED]
        found = [_score(AS_MEASURED, "", measured, measured)]
        for cause, by in self._replaced_by.items():
            if cause in self._errors:
                found.append(_score(cause, by, measured, self._errors[cause]))
        return found


def _score(
    name: str, replaced_by: str, measured: dict[object, SlopeError], without: dict[object, SlopeError]
) -> CauseScore:
    common = [frame for frame in measured if frame in without]
    left, whole = (_rows([errors[frame] for frame in common]) for errors in (without, measured))
    part = whole if name == AS_MEASURED else whole - left
    left_sagittal, left_frontal, left_height = _rms_of_rows(left)
    part_sagittal, part_frontal, part_height = _rms_of_rows(part)
    return CauseScore(
        name=name,
        replaced_by=replaced_by,
        frames=len(common),
        left_sagittal_deg=left_sagittal,
        left_frontal_deg=left_frontal,
        left_height_mm=left_height,
        part_sagittal_deg=part_sagittal,
        part_frontal_deg=part_frontal,
        part_height_mm=part_height,
    )


def _rows(errors: list[SlopeError]) -> FloatArray:
    """Return errors as (n, 3) in degrees, degrees and millimetres."""
    rows = np.array([(e.sagittal_rad, e.frontal_rad, e.height_m) for e in errors], dtype=np.float64).reshape(-1, 3)
    scaled: FloatArray = rows * (np.degrees(1.0), np.degrees(1.0), 1e3)
    return scaled


def _rms_of_rows(rows: FloatArray) -> list[float]:
    return column_rms(rows).tolist() if len(rows) else [float("nan")] * 3
