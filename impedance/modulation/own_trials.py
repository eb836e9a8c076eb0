"""Set-points from own trials on the platform, in place of the published numbers: `of_trials`."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from impedance.ankle.table import AnkleTable, AxisTable
from impedance.ankle.trial import Manoeuvre
from impedance.modulation.curve import SHARES
from impedance.modulation.table import SetpointTable, published
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.errors import UserError

LEVEL_DEG: Final = 1.0
"""A trial on ground no steeper than this is one of level ground."""
_APART_DEG: Final = 2.5
"""A published slope nearer than this to that of an own trial is not used."""


def of_trials(trials: Sequence[AnkleTable], names: Sequence[str]) -> SetpointTable:
    """Return the table in which own `trials` of straight walking replace the published numbers; `names` for errors.

    Where a trial tells nothing, outside the foot-flat part of stance or where it was not identifiable, and on slopes
    without one, stands what was published, moved to the own level ground: the equilibrium by the difference, stiffness
    and damping by the ratio. Raises UserError where no trial is of level ground, two are of one slope, or one is of
    another manoeuvre.
    """
    for trial, name in zip(trials, names, strict=True):
        if trial.manoeuvre is not Manoeuvre.STRAIGHT:
            raise UserError(
                f"{name}: manoeuvre is '{trial.manoeuvre.value}', allowed straight: a set-point is for walking"
            )
    slopes = [trial.ground_slope_deg for trial in trials]
    near = [slope for slope in slopes if abs(slope) <= LEVEL_DEG]
    if len(near) != 1:
        raise UserError(
            f"set-points from {', '.join(names)}: {len(near)} trials of level ground (ground_slope_deg within "
            f"±{LEVEL_DEG:g}), allowed 1"
        )
    order = np.argsort(slopes)
    if np.any(np.diff(np.array(slopes)[order]) < LEVEL_DEG):
        raise UserError(f"set-points from {', '.join(names)}: two trials are of slopes less than {LEVEL_DEG:g}° apart")
    base = published()
    own_level, _ = _own(trials[slopes.index(near[0])], *_row(base, 0.0))
    moved = _moved(base, own_level)
    rows = [(trial.ground_slope_deg, *_own(trial, *_row(moved, trial.ground_slope_deg))) for trial in trials]
    for k, slope_deg in enumerate(np.rad2deg(base.slopes_rad)):
        if all(abs(slope_deg - own) >= _APART_DEG for own in slopes):
            rows.append((float(slope_deg), moved.values[k], moved.deviations[k]))
    rows.sort(key=lambda row: row[0])
    return SetpointTable(
        np.deg2rad([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows]),
        ", ".join(names),
    )


def _row(table: SetpointTable, slope_deg: float) -> tuple[FloatArray, FloatArray]:
    """Return values and deviations (5, 3) per kg at a slope, of the steepest beyond the table's ends."""
    slope_rad = float(np.clip(np.deg2rad(slope_deg), table.slopes_rad[0], table.slopes_rad[-1]))
    curve, deviations = table.at(slope_rad, 0.0, 1.0)
    return curve.points, deviations


def _moved(table: SetpointTable, own_level: FloatArray) -> SetpointTable:
    """Return the table moved to another level ground: (5, 3) per kg."""
    level, _ = _row(table, 0.0)
    ratio = np.column_stack((np.ones(len(SHARES)), own_level[:, 1:] / level[:, 1:]))
    shift = np.column_stack((own_level[:, 0] - level[:, 0], np.zeros((len(SHARES), 2))))
    return SetpointTable(table.slopes_rad, table.values * ratio + shift, table.deviations * ratio, table.name)


def _own(trial: AnkleTable, values: FloatArray, deviations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what the trial tells per kg at `SHARES`, and `values` and `deviations` (5, 3) where it tells nothing."""
    stance, axis = 0.01 * np.array(trial.stance_percent), trial.dorsi_plantarflexion
    columns = [
        _told(axis, name, stance, per)
        for name, per in (
            ("equilibrium_rad", 1.0),
            ("stiffness_nm_per_rad", trial.body_mass_kg),
            ("damping_nms_per_rad", trial.body_mass_kg),
        )
    ]
    own, own_sd = (np.column_stack([column[k] for column in columns]) for k in (0, 1))
    known = np.isfinite(own)
    return np.where(known, own, values), np.where(known, own_sd, deviations)


def _told(axis: AxisTable, name: str, stance: FloatArray, per: float) -> tuple[FloatArray, FloatArray]:
    """Return one curve of a trial and its deviation (5,) at `SHARES`; NaN where it tells nothing."""
    value = np.array(getattr(axis, name), dtype=np.float64)
    if not len(value):
        nothing = np.full(len(SHARES), np.nan)
        return nothing, nothing
    deviation = (np.array(getattr(axis, f"{name}_high")) - np.array(getattr(axis, f"{name}_low"))) / (2.0 * NORMAL_95)
    inside = (stance[0] - _BESIDE <= SHARES) & (stance[-1] + _BESIDE >= SHARES)
    found, found_sd = (np.where(inside, np.interp(SHARES, stance, each) / per, np.nan) for each in (value, deviation))
    return found, found_sd


_BESIDE = 0.05
"""A point so near the ends of what a trial tells counts as told."""
