"""Who walks where in a hidden-effect case: the unit, the ground, the pace, the light; everything that is no effect."""

import math
from dataclasses import dataclass, replace

import numpy as np

from lab.hidden.case import Case, log_uniform
from lab.hidden.wearable.recording import FRAME_NS, Scene
from sim_rig.unit import Unit, draw_unit
from sim_rig.walk.gait import Gait
from sim_rig.walk.legs import Stand, Walk
from sim_rig.walk.world import World, WorldBuilder

FRAMES = 100
_TEXTURES = ("concrete", "gravel", "asphalt", "grass", "brick")
_START_NS = 20_000_000_000
_WALKING_NS = 2_000_000_000
_STAND_S = 0.5
_WAY_M = 14.0
_ROLLING_GRID_M = 0.4
_HIP_M = (0.85, 1.05)
_SLOPE_DEG = 6.0
_EXPOSURE_S = (0.8e-3, 1.6e-3)


@dataclass(frozen=True)
class Nuisance:
    """What a recording is like besides its effects. `textures` are those of pieces of ground in turn."""

    seed: int
    speed_mps: float
    step_hz: float
    hip_height_m: float
    slope_deg: float
    textures: tuple[str, ...]
    exposure_s: float
    noise: float


def draw_nuisance(case: Case, recording: str, noise: float) -> Nuisance:
    """Return what is drawn anew for each `recording` of a case, whose noise level is `noise` times the usual."""
    random = case.stream(f"{recording}/walk")
    pieces = tuple(str(name) for name in random.permutation(_TEXTURES))
    return Nuisance(
        seed=int(random.integers(1 << 31)),
        speed_mps=float(random.uniform(0.8, 1.4)),
        step_hz=float(random.uniform(1.5, 2.1)),
        hip_height_m=float(random.uniform(*_HIP_M)),
        slope_deg=float(random.uniform(-_SLOPE_DEG, _SLOPE_DEG)),
        textures=pieces,
        exposure_s=log_uniform(random, *_EXPOSURE_S),
        noise=noise,
    )


def faultless_unit(seed: int) -> Unit:
    """Return a unit of the rig whose gyroscope does not respond to gravity: its calibration has no place for that."""
    unit = draw_unit(seed)
    return replace(unit, name="wearer", chip=replace(unit.chip, g_sensitivity=np.zeros((3, 3))))


def ramp_world(nuisance: Nuisance) -> World:
    """Return one plane that is long enough for the recording, and the way back down."""
    ground = WorldBuilder()
    for slope_deg in (nuisance.slope_deg, -nuisance.slope_deg):
        for texture in nuisance.textures:
            ground.ramp(_WAY_M / len(nuisance.textures), slope_deg, texture)
    return ground.build()


def rolling_world(nuisance: Nuisance, curvature_per_m: float) -> World:
    """Return ground whose slope changes by `curvature_per_m` a metre, there and back."""
    ground = WorldBuilder()
    count = round(_WAY_M / _ROLLING_GRID_M)
    # a valley and a hill of the same size; the wearer walks through the first only
    for bend in (curvature_per_m, -curvature_per_m):
        for i in range(count):
            slope = bend * ((i + 0.5) * _ROLLING_GRID_M - 0.5 * _WAY_M)
            texture = nuisance.textures[i * len(nuisance.textures) // count]
            ground.ramp(_ROLLING_GRID_M, math.degrees(math.atan(slope)), texture)
    return ground.build()


def faultless_scene(unit: Unit, nuisance: Nuisance, world: World | None = None) -> Scene:
    """Return a recording in which nothing is wrong: the calibration tells the truth."""
    world = world or ramp_world(nuisance)
    legs = (Stand(_STAND_S), Walk(world.length_m, nuisance.speed_mps, nuisance.step_hz), Stand(_STAND_S))
    gait = Gait(world, legs, nuisance.hip_height_m, nuisance.seed, _START_NS)

    def exposure_s(k: int) -> float:
        return nuisance.exposure_s * (1.0 + 0.1 * math.sin(2.0 * math.pi * k * FRAME_NS * 1e-9 / 3.0))

    return Scene(
        unit=unit,
        told=unit.exact_calibration(),
        world=world,
        gait=gait,
        seed=nuisance.seed,
        first_ns=_START_NS + _WALKING_NS,
        frames=FRAMES,
        exposure_s=exposure_s,
        reference_noise=(5e-5 * nuisance.noise, 5e-5 * nuisance.noise),
        pixel_noise=1.0 * nuisance.noise,
    )
