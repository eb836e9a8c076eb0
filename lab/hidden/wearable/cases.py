"""Hidden-effect cases of the wearable: two walks of one unit, 5 s each at 20 frames/s, with the same causes in both.

A recording is 100 pairs of 640×360 px, 46 MB; it takes 6 s of one core, 9 s where pictures are altered.
Everything is rendered, sampled and written as on hardware; nothing here knows what a cause does to disparity.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from lab.hidden.case import Case, Kind, Sizes, TrueCause, Truth, log_uniform
from lab.hidden.wearable.physics import Hidden, hidden
from lab.hidden.wearable.recording import write_recording
from lab.hidden.wearable.walk import draw_nuisance, faultless_scene, faultless_unit, rolling_world

SYSTEM = "wearable"

SIZES: Mapping[str, Sizes] = {
    "imu_bias": Sizes(0.05, 0.8, "m/s²"),  # a gyroscope's counts as 1 m/s² for each 0.05 rad/s
    "acceleration_disturbance": Sizes(0.15, 1.5, "m/s²"),
    "extrinsic_rotation": Sizes(0.003, 0.05, "rad"),
    "time_offset": Sizes(1e-3, 15e-3, "s"),
    "baseline_error": Sizes(0.004, 0.05, "1"),
    "focal_error": Sizes(0.008, 0.05, "1"),
    "toe_in": Sizes(5e-4, 5e-3, "rad"),
    "distortion_residual": Sizes(0.005, 0.03, "1"),
    "motion_blur": Sizes(3e-3, 12e-3, "s"),
    "rolling_shutter": Sizes(3e-3, 16e-3, "s"),
    "pixel_locking": Sizes(0.03, 0.3, "px"),
    "exposure_change": Sizes(0.2, 1.5, "1"),
    "texture_bias": Sizes(0.06, 0.3, "px"),
    "ground_not_flat": Sizes(0.01, 0.06, "1/m"),
    "soft_mount": Sizes(4.0, 12.0, "Hz"),
    "dirty_lens": Sizes(0.3, 2.0, "px"),
    "eyes_out_of_step": Sizes(0.5e-3, 8e-3, "s"),
    "repeated_frame": Sizes(0.05, 0.25, "1"),
    "creeping_slope": Sizes(0.005, 0.06, "rad"),
    "lens_breathing": Sizes(0.003, 0.03, "1"),
    "vibration": Sizes(0.001, 0.01, "rad"),
    "jittering_stamps": Sizes(2e-3, 15e-3, "s"),
}

OUTSIDE: tuple[str, ...] = (
    "dirty_lens",
    "eyes_out_of_step",
    "repeated_frame",
    "creeping_slope",
    "lens_breathing",
    "vibration",
    "jittering_stamps",
)

EFFECTS: tuple[str, ...] = tuple(name for name in SIZES if name not in OUTSIDE)

PAIRS: tuple[tuple[str, str], ...] = (
    ("time_offset", "extrinsic_rotation"),
    ("baseline_error", "imu_bias"),
    ("toe_in", "time_offset"),
    ("extrinsic_rotation", "imu_bias"),
    ("rolling_shutter", "baseline_error"),
    ("distortion_residual", "time_offset"),
    ("acceleration_disturbance", "toe_in"),
    ("focal_error", "extrinsic_rotation"),
    ("pixel_locking", "extrinsic_rotation"),
    ("ground_not_flat", "imu_bias"),
)

LOOK_ALIKES: tuple[tuple[str, ...], ...] = (
    ("focal_error", "distortion_residual", "toe_in", "ground_not_flat", "baseline_error", "extrinsic_rotation"),
    ("imu_bias", "acceleration_disturbance"),
)

_NOISE = (0.5, 2.0)


def write(case: Case, folder: Path, held_out: Path) -> Truth:
    """Write both recordings of `case`; return the truth. Everything follows from `case`."""
    cv2.setNumThreads(1)
    noise = log_uniform(case.stream("noise"), *_NOISE)
    unit = faultless_unit(int(case.stream("unit").integers(1 << 31)))
    sizes = {name: SIZES[name].drawn(case.stream(f"size/{name}")) for name in case.effects}
    nuisance: dict[str, float | bool | str] = {"noise": noise}
    causes: dict[str, Hidden] = {}
    for recording, path in (("fit", folder), ("held_out", held_out)):
        causes = {name: hidden(name, size, case.stream(f"cause/{name}")) for name, size in sizes.items()}
        walk = draw_nuisance(case, recording, noise)
        bends = [cause.curvature_per_m for cause in causes.values() if cause.curvature_per_m != 0.0]
        world = rolling_world(walk, bends[0]) if bends else None
        scene = faultless_scene(unit, walk, world)
        for cause in causes.values():
            scene = cause.change(scene)
        write_recording(replace(scene, seed=walk.seed), path)
        nuisance |= {f"{recording}_speed_mps": walk.speed_mps, f"{recording}_slope_deg": walk.slope_deg}
    strongest = sorted(sizes, key=lambda name: -np.log(sizes[name] / SIZES[name].low))
    return Truth(
        system=SYSTEM,
        seed=case.seed,
        kind=case.kind,
        causes=tuple(
            TrueCause(name=name, parameters=causes[name].parameters, size=sizes[name], unit=SIZES[name].unit)
            for name in strongest
            if case.kind is not Kind.CLEAN
        ),
        nuisance=nuisance,
    )
