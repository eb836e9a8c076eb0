"""The table of an ankle's trial in straight walking, for the tests of set-points."""

import msgspec

from impedance.ankle.table import AnkleTable, AxisTable
from impedance.ankle.trial import Manoeuvre


def trial(slope_deg: float, stiffness: float = 300.0, equilibrium: float = 0.02, **changes: object) -> AnkleTable:
    """A trial of a body of 60 kg that tells 20 to 80 % of stance."""
    percent = [20.0, 50.0, 80.0]

    def curve(name: str, value: float, half: float) -> dict[str, list[float]]:
        return {name: [value] * 3, f"{name}_low": [value - half] * 3, f"{name}_high": [value + half] * 3}

    told = {
        **curve("stiffness_nm_per_rad", stiffness, 0.05 * stiffness),
        **curve("damping_nms_per_rad", 3.0, 0.3),
        **curve("equilibrium_rad", equilibrium, 0.01),
        **curve("mean_moment_nm", -50.0, 2.0),
    }
    axis = msgspec.convert(
        {
            **told,
            "foot_inertia_kgm2": 0.01,
            "foot_inertia_kgm2_low": 0.009,
            "foot_inertia_kgm2_high": 0.011,
            "not_identifiable": [],
        },
        AxisTable,
    )
    made = AnkleTable(
        manoeuvre=Manoeuvre.STRAIGHT,
        ground_slope_deg=slope_deg,
        subject="S1",
        body_mass_kg=60.0,
        perturbed_cycles=20,
        stance_percent=percent,
        dorsi_plantarflexion=axis,
        inversion_eversion=axis,
    )
    return msgspec.structs.replace(made, **changes)
