"""Recordings of the vibrating platform in which something is hidden: in MuJoCo's mechanics, or in its instruments."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from impedance.recording.recording import PlatformRecording
from lab.hidden.case import Case, Kind, TrueCause, Truth
from lab.hidden.platform.drawn import EFFECTS, NEEDS_FOOT, NEEDS_KNOWN_PLATE, OUTSIDE, SIZES, Drawn, drawn
from lab.hidden.platform.scene import nuisance, platform_unit, tones
from messages.arrays import FloatArray
from sim_rig.platform.extended.flaws import Flaws, combined
from sim_rig.platform.extended.laboratory import Laboratory, Reference
from sim_rig.platform.extended.mechanics import Torques
from sim_rig.platform.extended.plate_noise import PlateNoise
from sim_rig.platform.extended.unit import PlatformUnit, stepped
from sim_rig.platform.run import SPAN_NM

__all__ = ["EFFECTS", "LOOK_ALIKES", "OUTSIDE", "PAIRS", "SIZES", "write"]

DURATION_S: Final = 20.0
HELD_OUT_S: Final = 12.0
PAIRS: Final = (
    ("force_delay", "force_gain"),
    ("force_delay", "crosstalk"),
    ("force_delay", "plate_rotation"),
    ("force_lag", "force_gain"),
    ("force_lag", "tare_error"),
    ("motion_smoothing", "crosstalk"),
    ("reference_height", "force_delay"),
    ("coulomb_friction", "force_delay"),
    ("parallel_damping", "crosstalk"),
    ("clock_drift", "force_gain"),
    ("plate_rotation", "tare_error"),
    ("position_scale", "force_delay"),
    ("saturation", "force_delay"),
    ("backlash", "force_delay"),
    ("dropped_samples", "force_gain"),
)
"""None of them changes the motion, so that what either does can be told apart."""
LOOK_ALIKES: Final = (
    (
        "force_gain",
        "crosstalk",
        "reference_height",
        "parallel_spring",
        "plate_rotation",
        "tare_error",
        "hidden_mass",
    ),
    ("force_delay", "force_lag", "clock_drift"),
    ("parallel_damping", "coulomb_friction"),
    ("joint_offset", "position_scale", "foot_marker_offset"),
)
"""Classes within which one effect takes most of another's χ² (`python -m benchmarks.platform_look_alikes`).

Forces and moments of a rigid body on a joint follow from two angles: whatever mixes constant shares of them looks like
other shares, and a share of the foot's weight like a constant. On the bare plate a scale of positions is an offset of
the joint's height to 1e-6.
"""


def write(case: Case, folder: Path, held_out: Path) -> Truth:
    """Write both recordings of a case, and return its truth; everything is drawn from `case` alone."""
    hidden = _hidden(case)
    unit = _unit(case, hidden)
    laboratory = Laboratory(unit, _flaws(hidden), PlateNoise(6, case.stream("colour")))
    torques, held_out_torques = _torques(case, unit, jumps=laboratory.flaws.jumps)

    fine = laboratory.ran(torques, DURATION_S)
    hidden = [each.scaled(laboratory.reference(fine)) for each in hidden]
    laboratory = replace(laboratory, flaws=_flaws(hidden))
    recording = laboratory.recorded(fine, case.stream("noise"), DURATION_S)
    recording.save(folder)
    fine = laboratory.ran(held_out_torques, HELD_OUT_S)
    laboratory.recorded(fine, case.stream("held_out/noise"), HELD_OUT_S).save(held_out)

    if len(hidden) > 1:
        shares = []
        for each in hidden:
            less = replace(laboratory, flaws=_flaws([other for other in hidden if other is not each]))
            without = less.recorded(less.ran(torques, DURATION_S), case.stream("noise"), DURATION_S)
            shares.append(_difference(recording, without, unit))
        hidden = [hidden[k] for k in np.argsort(shares)[::-1]]
    causes = tuple(each.cause for each in hidden)
    return Truth(system=case.system, seed=case.seed, kind=case.kind, causes=causes, nuisance=nuisance(unit))


@dataclass(frozen=True)
class _Hidden:
    """One effect of a case, as it was drawn."""

    effect: str
    size: float
    drawn: Drawn

    @property
    def cause(self) -> TrueCause:
        return TrueCause(self.effect, dict(self.drawn.parameters), self.size, SIZES[self.effect].unit)

    def scaled(self, reference: Reference) -> "_Hidden":
        """Return it with all that depends on how large the channels of the fit recording are."""
        return replace(self, drawn=self.drawn.scaled(reference))


def _hidden(case: Case) -> list[_Hidden]:
    random = case.stream("effects")
    hidden = []
    for effect in case.effects:
        size = SIZES[effect].drawn(random)
        hidden.append(_Hidden(effect, size, drawn(effect, size, random)))
    return hidden


def _flaws(hidden: Sequence[_Hidden]) -> Flaws:
    return combined([each.drawn.fields for each in hidden])


def _unit(case: Case, hidden: Sequence[_Hidden]) -> PlatformUnit:
    """Return a unit on which the case's effects can show, and of a withheld one all that is left out with it; one that
    aliases is updated at the effect's size, Hz.
    """
    bare = any(effect in NEEDS_KNOWN_PLATE for effect in case.effects)
    left_out = [set(alike) for alike in LOOK_ALIKES if case.kind is Kind.WITHHELD and set(alike) & set(case.effects)]
    loaded = any(effect in NEEDS_FOOT for effect in set(case.effects).union(*left_out))
    with_foot = False if bare else True if loaded else None
    unit = platform_unit(case.stream("scene"), with_foot=with_foot, known=True if bare else None)
    update_hz = next((each.size for each in hidden if each.effect == "aliasing"), unit.update_hz)
    return replace(unit, update_hz=update_hz)


def _torques(case: Case, unit: PlatformUnit, *, jumps: bool) -> tuple[Torques, Torques]:
    """Return the fit recording's torques, and the held-out one's: tones, or steps too where steps are the effect."""
    span_nm: FloatArray = unit.amplitude * np.array(SPAN_NM)
    random = case.stream("held_out/torques")
    other = stepped(random, unit.update_hz, span_nm, HELD_OUT_S) if jumps else tones(random, span_nm)
    return stepped(case.stream("torques"), unit.update_hz, span_nm, DURATION_S), other


def _difference(a: PlatformRecording, b: PlatformRecording, unit: PlatformUnit) -> float:
    """Return the RMS of what differs, each channel by its noise."""
    parts = [(a.wrench - b.wrench) / unit.wrench_noise, (a.plate.columns - b.plate.columns) / unit.pose_noise]
    if a.foot is not None and b.foot is not None:
        parts.append((a.foot.columns - b.foot.columns) / unit.pose_noise)
    return float(np.sqrt(np.mean(np.hstack(parts) ** 2)))
