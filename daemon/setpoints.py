"""Set-points of the ankle as the configuration asks for them: off until it tells the wearer's mass."""

import logging
from pathlib import Path
from typing import Annotated

import msgspec

from impedance.modulation.modulator import Modulator
from impedance.modulation.table import SetpointTable, published
from messages import UserError

log = logging.getLogger("gaiteyes")


class SetpointSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The wearer's `mass_kg`, prosthesis included; without it there are no set-points.

    `tables` are files `ankle_impedance.toml` of own trials, one a slope, one of them of level ground; without one the
    published numbers stand (docs/setpoints.md). The side is that of `[foothold]`.
    """

    mass_kg: Annotated[float, msgspec.Meta(ge=30.0, le=150.0)] | None = None
    tables: list[str] = []


def modulator(settings: SetpointSettings, folder: Path = Path()) -> Modulator | None:
    """Return what makes set-points, or None where none are asked for; `folder` is that of the configuration.

    Raises UserError, in one line, for tables that cannot be read or used, and for tables without a mass.
    """
    if settings.mass_kg is None:
        if settings.tables:
            raise UserError("setpoint.tables without setpoint.mass_kg: set-points need the wearer's mass, 30 to 150 kg")
        return None
    return Modulator(_table(settings, folder), settings.mass_kg)


def modulator_of_recording(settings: SetpointSettings) -> Modulator | None:
    """Return what makes the set-points of a recording anew; None, with one warning, where its tables are not here."""
    try:
        return modulator(settings)
    except UserError as error:
        log.warning("replayed without set-points: %s", error)
        return None


def _table(settings: SetpointSettings, folder: Path) -> SetpointTable:
    if not settings.tables:
        return published()
    from impedance.ankle.table import load_table  # scipy, which a service without own trials does not load
    from impedance.modulation.own_trials import of_trials

    return of_trials([load_table(folder / name) for name in settings.tables], settings.tables)
