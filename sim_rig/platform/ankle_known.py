"""What a laboratory knows of a simulated trial: bodies and ankle, each off by its own deviation."""

from typing import Final

import numpy as np

from impedance.ankle.trial import Ankle, BodyPrior, FlatFoot, Manoeuvre, Mockup, Subject, TrialSettings
from messages.arrays import FloatArray
from sim_rig.platform.ankle_person import Person
from sim_rig.platform.ankle_sensed import JOINT_TO_SURFACE_M
from sim_rig.platform.rig import MOTION_HZ, PLATE

FLAT_FOOT: Final = (0.10, 0.80)
_ANKLE_M: Final = 0.002
_BEARING_M: Final = 0.0002
"""To what a person's ankle and a mock-up's bearing are measured."""


def settings_of(person: Person, slope_deg: float, rng: np.random.Generator) -> TrialSettings:
    """Return the trial's settings; a mock-up's foot was weighed and drawn, a person's comes from a table of bodies."""
    made = not person.restless
    plate = _prior(rng, PLATE.mass_kg, PLATE.cog_m, PLATE.inertia_kgm2, 0.005, 2e-4, 0.01)
    dm, dd, share = (0.005, 3e-4, 0.02) if made else (0.05 * person.foot_kg, 4e-3, 0.15)
    foot = _prior(rng, person.foot_kg, person.foot_cog_P_m, person.foot_kgm2, dm, dd, share)
    deviation_m = _BEARING_M if made else _ANKLE_M
    x, y, z = (person.ankle_P_m + deviation_m * rng.standard_normal(3)).tolist()
    springs = tuple(person.stiffness(np.array(0.5)).tolist()), tuple(person.damping(np.array(0.5)).tolist())
    walks = Manoeuvre.STRAIGHT if person.walks else Manoeuvre.STANDING
    return TrialSettings(
        manoeuvre=Manoeuvre.MOCKUP if made else walks,
        ground_slope_deg=slope_deg,
        rate_hz=MOTION_HZ,
        joint_to_surface_m=JOINT_TO_SURFACE_M,
        subject=Subject(code="mock-up" if made else "simulated", mass_kg=round(person.mass_kg, 1)),
        flat_foot=FlatFoot(100.0 * FLAT_FOOT[0], 100.0 * FLAT_FOOT[1]),
        ankle=Ankle(in_plate_m=(x, y, z), deviation_m=deviation_m),
        plate=plate,
        foot=foot,
        mockup=Mockup(*springs) if made else None,
    )


def _prior(
    rng: np.random.Generator, mass_kg: float, cog_m: FloatArray, J: FloatArray, dm: float, dd: float, share: float
) -> BodyPrior:
    """Return a body as it was measured before: mass ± dm, centre of gravity ± dd, tensor ± `share` of its moments."""
    tensor = J[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    deviation = share * np.concatenate((np.diag(J), np.full(3, np.diag(J).min())))
    return BodyPrior(
        mass_kg + dm * float(rng.standard_normal()),
        tuple((cog_m + dd * rng.standard_normal(3)).tolist()),
        tuple((tensor + deviation * rng.standard_normal(6)).tolist()),
        dm,
        (dd, dd, dd),
        tuple(deviation.tolist()),
    )
