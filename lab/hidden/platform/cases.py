"""Recordings of the vibrating platform in which something is hidden: in MuJoCo's mechanics, or in its instruments."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from impedance.recording.recording import PlatformRecording
from lab.hidden.case import Case, TrueCause, Truth
from lab.hidden.platform.drawn import (
    EFFECTS,
    NEEDS_FOOT,
    NEEDS_KNOWN_PLATE,
    OUTSIDE,
    SIZES,
    drawn,
    together,
)
from lab.hidden.platform.laboratory import mechanics_of, recorded, reference_of
from lab.hidden.platform.mechanics import Torques, ran
from lab.hidden.platform.noise import PlateNoise
from lab.hidden.platform.scene import SPAN_NM, Scene, scene, stepped, tones

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
    draws = case.stream("effects")
    fields, told, sizes = [], [], []
    for effect in case.effects:
        sizes.append(SIZES[effect].drawn(draws))
        changed, parameters = drawn(effect, sizes[-1], draws)
        fields.append(changed)
        told.append(parameters)
    hidden = together(fields)
    alone = any(effect in NEEDS_KNOWN_PLATE for effect in case.effects)
    unit = scene(
        case.stream("scene"),
        with_foot=False if alone else True if any(effect in NEEDS_FOOT for effect in case.effects) else None,
        known=True if alone else None,
    )
    if hidden.jumps:
        unit = replace(unit, update_hz=sizes[case.effects.index("aliasing")])
    mechanics = mechanics_of(unit, hidden)
    span_nm = unit.amplitude * SPAN_NM
    torques = stepped(case.stream("torques"), unit.update_hz, span_nm, DURATION_S)
    other: Torques = (
        stepped(case.stream("held_out/torques"), unit.update_hz, span_nm, HELD_OUT_S)
        if hidden.jumps
        else tones(case.stream("held_out/torques"), span_nm)
    )
    colour = PlateNoise(6, case.stream("colour"))
    reference = None
    for place, purpose, pushed, duration_s in (
        (folder, "", torques, DURATION_S),
        (held_out, "held_out/", other, HELD_OUT_S),
    ):
        fine = ran(mechanics, pushed, duration_s)
        if reference is None:
            reference = reference_of(fine, mechanics)
        random = case.stream(f"{purpose}noise")
        recording = recorded(unit, hidden, mechanics, fine, reference, colour, random, duration_s)
        recording.save(place)
        if not purpose:
            fitted = recording
    assert reference is not None
    for parameters in told:
        for name, value in parameters.items():
            if np.isnan(value):
                k, share = hidden.play or hidden.limit or (0, 0.0)
                parameters[name] = float(share * (reference.deviation if hidden.play else reference.largest)[k])
    causes = [
        TrueCause(name=effect, parameters=parameters, size=size, unit=SIZES[effect].unit)
        for effect, parameters, size in zip(case.effects, told, sizes, strict=True)
    ]
    if len(causes) > 1:
        shares = []
        for k in range(len(causes)):
            less = together([each for other, each in enumerate(fields) if other != k])
            other_mechanics = mechanics_of(unit, less)
            fine = ran(other_mechanics, torques, DURATION_S)
            random = case.stream("noise")
            without = recorded(unit, less, other_mechanics, fine, reference, colour, random, DURATION_S)
            shares.append(_difference(fitted, without, unit))
        causes = [causes[int(k)] for k in np.argsort(shares)[::-1]]
    return Truth(system=case.system, seed=case.seed, kind=case.kind, causes=tuple(causes), nuisance=unit.nuisance)


def _difference(a: PlatformRecording, b: PlatformRecording, unit: Scene) -> float:
    """Return the RMS of what differs, each channel by its noise."""
    parts = [(a.wrench - b.wrench) / unit.wrench_noise, (a.plate.columns - b.plate.columns) / unit.pose_noise]
    if a.foot is not None and b.foot is not None:
        parts.append((a.foot.columns - b.foot.columns) / unit.pose_noise)
    return float(np.sqrt(np.mean(np.hstack(parts) ** 2)))
