"""Impedance by condition: the tables of one subject's trials, one for each slope and manoeuvre, in one file.

`ankle_conditions.toml` holds a list `condition` of what `ankle_impedance.toml` holds, manoeuvres together and slopes
rising; of one condition it holds one table.
"""

from collections.abc import Sequence
from math import degrees
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from impedance.ankle.table import AnkleTable, check_table, load_table
from impedance.recording.plain_files import read_toml, write_toml
from messages.checked import checked
from messages.errors import UserError

COLUMNS: Final = (
    "manoeuvre",
    "slope °",
    "cycles",
    "stance",
    *("N·m/rad Z", "N·m·s/rad Z", "equilibrium ° Z"),
    *("N·m/rad X", "N·m·s/rad X", "equilibrium ° X"),
)
_HEADING: Final = """\
# Intrinsic impedance of one subject's ankle, condition by condition: manoeuvre and slope of the ground.
"""
_SHOWN_PERCENT: Final = (20.0, 45.0, 70.0)
"""Shares of stance that a person is shown: after foot flat, mid-stance, before heel off."""


class Conditions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What `ankle_conditions.toml` holds."""

    condition: list[AnkleTable]


def gathered(paths: Sequence[Path]) -> Conditions:
    """Return the tables of files in order; raises UserError where one is wrong, doubled, or of another subject."""
    tables = [load_table(path) for path in paths]
    _check(tables, [str(path) for path in paths])
    return Conditions(sorted(tables, key=lambda table: (table.manoeuvre.value, table.ground_slope_deg)))


def save_conditions(path: Path, conditions: Conditions) -> None:
    """Write the file in one step; raises UserError where it cannot."""
    write_toml(path, msgspec.to_builtins(conditions), _HEADING)


def load_conditions(path: Path) -> Conditions:
    """Return the checked file; raises UserError, one line with file, field and what is allowed."""
    conditions = checked(read_toml(path), Conditions, str(path))
    for place, table in enumerate(conditions.condition):
        check_table(table, f"{path}: condition[{place}]")
    _check(conditions.condition, [f"{path}: condition[{place}]" for place in range(len(conditions.condition))])
    return conditions


def rows(conditions: Conditions) -> list[list[str]]:
    """Return the conditions at a few shares of stance, for a table of `COLUMNS`; refused values say so."""
    shown = []
    for table in conditions.condition:
        stance = np.array(table.stance_percent)
        for percent in _SHOWN_PERCENT:
            if not stance[0] <= percent <= stance[-1]:
                continue
            k = int(np.argmin(np.abs(stance - percent)))
            cells = [
                f"{value:.{digits}f}" if np.isfinite(value) else "refused"
                for axis in table.axes()
                for value, digits in (
                    (axis.stiffness_nm_per_rad[k], 1),
                    (axis.damping_nms_per_rad[k], 3),
                    (degrees(axis.equilibrium_rad[k]) if axis.equilibrium_rad else np.nan, 2),
                )
            ]
            about = [table.manoeuvre.value, f"{table.ground_slope_deg:+g}", f"{table.perturbed_cycles}"]
            shown.append([*about, f"{stance[k]:.0f} %", *cells])
    return shown


def _check(tables: Sequence[AnkleTable], names: Sequence[str]) -> None:
    seen: dict[tuple[str, float], str] = {}
    for table, name in zip(tables, names, strict=True):
        if table.subject != tables[0].subject:
            raise UserError(f"{name}: subject is {table.subject!r}, that of {names[0]} is {tables[0].subject!r}")
        condition = (table.manoeuvre.value, table.ground_slope_deg)
        if condition in seen:
            raise UserError(
                f"{name}: {condition[0]} at {condition[1]:g}° stands in {seen[condition]} already; one of each"
            )
        seen[condition] = name
