"""Walks over changes of the ground, drawn from a seed: what comes, its dimensions, surfaces, light, pace and course.

Each walk stands for a moment, walks up to one change of the ground, over it and on; or it only stands before one. The
change is met square, or at up to 35°. Every walk is over before its lap ends; a ramp far behind closes the lap.
"""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim_rig.walk.footholds import Footholds
from sim_rig.walk.gait import Gait, Habits
from sim_rig.walk.legs import Leg, Stand, Walk
from sim_rig.walk.own_legs import OwnLegs
from sim_rig.walk.passers_by import PassersBy
from sim_rig.walk.relief import Relief
from sim_rig.walk.scenario import Pace, Scenario
from sim_rig.walk.shade import Shade
from sim_rig.walk.things import Thing
from sim_rig.walk.walker_ahead import WalkerAhead
from sim_rig.walk.world import World, WorldBuilder

CASES = (
    *("plain",) * 4,
    *("stairs-up", "stairs-down") * 2,
    *("kerb-up", "kerb-down", "step-up", "step-down"),
    *("ramp-up", "ramp-down", "dropped-kerb", "dropped-kerb"),
    *("rough", "rough", "above-stairs", "below-stairs"),
)
"""What the seeds of a block of this length are about, each in an order of its own."""

STANDING_S = 1.6
"""How long a walk stands before it begins: the attitude starts with a second at rest."""

LEAST_S = STANDING_S + 6.0
_MOST_S = 11.0
_BEYOND_M = 1.2  # walked beyond the change, by the hip
_CLEAR_M = 6.5  # of level ground beyond the change: more than is in view
_CLOSING_DEG = 10.0
_PACE_CHANGE_S = 1.0  # see `legs`
GROUNDS = ("concrete", "paving", "gravel", "asphalt", "brick", "grass", "wood")
RISERS = ("kerbstone", "wood", "concrete")
_MOST_COURSE_RAD = math.radians(35.0)
_USUAL = Habits(step_scatter_s=0.015)
_FOOT_FROM_LIP_M = 0.05
RUN_UP_GRID_M, RUN_UPS = 0.03, 24


@dataclass(frozen=True)
class TerrainWalk:
    """One drawn walk of `seconds`; `dimensions` says what was drawn, in SI units."""

    case: str
    seed: int
    seconds: float
    dimensions: dict[str, float]
    scenario: Scenario


@dataclass(frozen=True)
class _Change:
    """A change of the ground from its first to its last edge: `lay` puts it down; a flight has a tread and a pace."""

    lay: Callable[[WorldBuilder], None]
    dimensions: dict[str, float]
    tread_m: float = 0.0
    relief: Relief | None = None


def terrain_walk(seed: int) -> TerrainWalk:
    """Return the walk that `seed` draws."""
    block, place = divmod(seed, len(CASES))
    case = CASES[np.random.default_rng([block, 31]).permutation(len(CASES))[place]]
    chance = np.random.default_rng([seed, 30])
    change = _DRAWN[case](chance)
    course_rad = float(chance.uniform(-1.0, 1.0) * _MOST_COURSE_RAD) if chance.random() < 0.6 else 0.0
    speed_mps = float(chance.uniform(0.6, 1.5))
    pace = Pace(speed_mps, float((0.95 + 0.7 * speed_mps) * chance.uniform(0.94, 1.06)))
    stairs_hz = float(chance.uniform(1.2, 1.8))
    plain, camera_m = str(chance.choice(GROUNDS)), float(chance.uniform(0.8, 1.0))
    run_up_m = float(chance.uniform(2.2, 3.2))
    scenario = Scenario(
        name=f"terrain-{seed}",
        description=f"{case}, drawn by seed {seed}",
        world=_SOMEWHERE,
        legs=(Stand(60.0),),
        hip_height_m=camera_m,
        habits=_USUAL,
        things=_people(chance, case),
        contrast=float(chance.uniform(0.4, 1.0)),
        course_rad=course_rad,
    )
    lights = _Lights(chance)
    if case in ("above-stairs", "below-stairs"):
        run_up_m = math.cos(course_rad) * float(
            chance.uniform(*((0.55, 0.65) if case == "above-stairs" else (0.5, 1.3)))
        )
        world, _ = _world(change, run_up_m, plain, lights)
        return TerrainWalk(case, seed, LEAST_S, change.dimensions, replace(scenario, world=world))
    for attempt in range(RUN_UPS):
        at_m = run_up_m + attempt * RUN_UP_GRID_M
        world, end_m = _world(change, at_m, plain, lights)
        legs = _legs(change, at_m, end_m, world.length_m, pace, stairs_hz, course_rad)
        walk = replace(scenario, world=world, legs=legs)
        if not change.tread_m or steps_on_every_tread(walk, seed):
            break
    dimensions = change.dimensions | {"course_rad": course_rad, "speed_mps": speed_mps, "camera_m": camera_m}
    seconds = min(max(passes_s(walk, seed, end_m + _BEYOND_M), LEAST_S), _MOST_S)
    return TerrainWalk(case, seed, seconds, dimensions, walk)


def steps_on_every_tread(walk: Scenario, seed: int) -> bool:
    """Return whether one foot lands on each tread of the walk's first lap, well away from its edges."""
    footholds = Footholds(walk.world, walk.gait(seed, 0), seed)
    lips = [piece.lip_x_m for piece in walk.world.lap if piece.is_riser]
    landed: Counter[int] = Counter()
    for x_m in footholds.meant_x_m:
        if lips[0] < x_m < lips[-1]:
            on = int(np.searchsorted(lips, x_m))
            landed[on] += 1
            if min(x_m - lips[on - 1], lips[on] - x_m) < _FOOT_FROM_LIP_M:
                return False
    treads = [k for k in range(1, len(lips)) if lips[k] - lips[k - 1] < _LONGEST_TREAD_M]
    return all(landed[k] == 1 for k in treads)


def _world(change: _Change, run_up_m: float, plain: str, lights: "_Lights") -> tuple[World, float]:
    """Return the world with the change after `run_up_m`, and where the change ends."""
    ground = WorldBuilder().level(run_up_m, plain)
    change.lay(ground)
    end_m = ground.x_m
    close_lap(ground, plain)
    if change.relief is not None:
        return ground.build(change.relief, lights.shades((run_up_m,))), end_m
    laid = ground.build()
    edges = sorted({piece.lip_x_m for piece in laid.lap if run_up_m - 0.1 < piece.lip_x_m < end_m + 0.1})
    return ground.build(shades=lights.shades(edges or (run_up_m,))), end_m


def close_lap(ground: WorldBuilder, plain: str) -> None:
    """Lay level ground behind a change, and far behind it the ramp that brings the lap back to its height."""
    height_m = ground.z_m
    ground.level(_CLEAR_M, plain)
    if height_m:
        ground.ramp(abs(height_m) / math.tan(math.radians(_CLOSING_DEG)), -math.copysign(_CLOSING_DEG, height_m), plain)
    ground.level(_CLEAR_M, plain)


def _legs(
    change: _Change,
    at_m: float,
    end_m: float,
    lap_m: float,
    pace: Pace,
    stairs_hz: float,
    course_rad: float,
) -> tuple[Leg, ...]:
    """Return the legs."""
    along = 1.0 / math.cos(course_rad)
    if not change.tread_m:
        return (Stand(STANDING_S), pace.to(lap_m * along), Stand(0.5))
    return legs_over_flight(at_m * along, end_m * along, lap_m * along, pace, change.tread_m * along, stairs_hz)


def legs_over_flight(
    from_m: float, to_m: float, lap_m: float, pace: Pace, tread_m: float, stairs_hz: float
) -> tuple[Leg, ...]:
    """Return the legs of a walk whose way leads over stairs `from_m` `to_m`: there one tread a step."""
    stairs_mps = tread_m * stairs_hz
    slowing_m = 0.5 * _PACE_CHANGE_S * (pace.speed_mps + stairs_mps) + 0.35
    return (
        Stand(STANDING_S),
        pace.to(from_m - slowing_m),
        Walk(to_m + 0.25, stairs_mps, stairs_hz),
        pace.to(lap_m),
        Stand(0.5),
    )


def passes_s(walk: Scenario, seed: int, x_m: float) -> float:
    """Return when the hip passes `x_m` of the first lap."""
    gait: Gait = walk.gait(seed, 0)
    t = np.arange(0.0, gait.lap_s, 0.05)
    return float(t[np.searchsorted(gait.course(t).xy_m[:, 0], x_m)])


class _Lights:
    """Hard shadows and painted strips on the ground, drawn once for a walk."""

    def __init__(self, chance: np.random.Generator) -> None:
        self._drawn = chance.random() < 0.6
        self._strips = chance.random() < 0.3
        self._factor, self._strip_factor = float(chance.uniform(0.3, 0.6)), float(chance.uniform(0.4, 0.7))
        self._turned_rad = chance.uniform(-1.0, 1.0, 3) * math.radians(60.0) * (chance.random(3) < 0.6)
        self._sun_rad = float(chance.uniform(-0.9, 0.9))
        self._beside_m = chance.uniform(-0.12, 0.12, 3) * (chance.random(3) < 0.7)  # on an edge, or beside it
        self._width_m = chance.uniform(0.08, 1.2, 3)
        self._which = chance.random(3)

    def shades(self, edges_m: "tuple[float, ...] | list[float]") -> tuple[Shade, ...]:
        """Return shadows that begin on or beside edges at these x, one of them on the way there, and strips."""
        shades = [Shade((1.0, 0.0, 0.0), x, x + 0.05, self._strip_factor) for x in edges_m] if self._strips else []
        if self._drawn:
            places = [edges_m[int(w * len(edges_m))] for w in self._which[:2]] + [0.5 * edges_m[0]]
            for x_m, turned, beside_m, width_m in zip(
                places, self._turned_rad, self._beside_m, self._width_m, strict=True
            ):
                level = math.cos(self._sun_rad)
                normal = (level * math.cos(turned), level * math.sin(turned), math.sin(self._sun_rad))
                from_m = normal[0] * (x_m + float(beside_m))
                shades.append(Shade(normal, from_m, from_m + float(width_m), self._factor))
        return tuple(shades)


def _people(chance: np.random.Generator, case: str) -> tuple[Thing, ...]:
    """Return the wearer's own legs in every fourth walk, and as often somebody else."""
    things: list[Thing] = [OwnLegs()] if chance.random() < 0.25 else []
    ahead = WalkerAhead(float(chance.uniform(1.5, 2.4)), float(chance.uniform(-0.35, 0.35)))
    who = chance.random()
    if case not in _WITHOUT_PEOPLE:
        things += [ahead] if who < 0.12 else [PassersBy(every_s=2.5)] if who < 0.25 else []
    return tuple(things)


def _flight(chance: np.random.Generator, sign: float) -> _Change:
    rise_m, tread_m = float(chance.uniform(0.12, 0.20)), float(chance.uniform(0.24, 0.36))
    nosing_m = float(chance.uniform(0.0, 0.025)) if chance.random() < 0.6 else 0.0
    count, riser, tread = int(chance.integers(3, 7)), str(chance.choice(RISERS)), str(chance.choice(GROUNDS))
    landing_m = (
        int(chance.integers(3, 6)) * tread_m if chance.random() < 0.3 else 0.0
    )  # so that steps keep their length

    def lay(ground: WorldBuilder) -> None:
        ground.stairs(count, sign * rise_m, tread_m, riser, tread, nosing_m)
        if landing_m:
            ground.level(landing_m + nosing_m, tread, "landing").stairs(
                count, sign * rise_m, tread_m, riser, tread, nosing_m
            )

    dimensions = {"rise_m": sign * rise_m, "tread_m": tread_m, "nosing_m": nosing_m, "count": count}
    return _Change(lay, dimensions | {"landing_m": landing_m}, tread_m)


def _edge(chance: np.random.Generator, sign: float, low_m: float, most_nosing_m: float) -> _Change:
    rise_m, nosing_m = float(chance.uniform(low_m, 0.20)), float(chance.uniform(0.0, 1.0)) * most_nosing_m
    face, beyond = str(chance.choice(RISERS)), str(chance.choice(GROUNDS))

    def lay(ground: WorldBuilder) -> None:
        ground.step(sign * rise_m, face, "kerb", nosing_m).level(2.0, beyond)

    return _Change(lay, {"rise_m": sign * rise_m, "nosing_m": nosing_m})


def _ramp(chance: np.random.Generator, sign: float) -> _Change:
    slope_deg, length_m = float(chance.uniform(4.0, 12.0)), float(chance.uniform(1.5, 4.0))
    surface = str(chance.choice(GROUNDS))

    def lay(ground: WorldBuilder) -> None:
        ground.ramp(length_m, sign * slope_deg, surface)

    return _Change(lay, {"slope_rad": sign * math.radians(slope_deg), "length_m": length_m})


def _dropped_kerb(chance: np.random.Generator) -> _Change:
    """Return a pavement that comes down to the street by a short ramp, or the way up."""
    sign = float(chance.choice((-1.0, 1.0)))
    height_m, length_m = float(chance.uniform(0.06, 0.15)), float(chance.uniform(0.6, 1.2))
    slope_deg = math.degrees(math.atan(height_m / length_m))
    surface, beyond = str(chance.choice(GROUNDS)), str(chance.choice(GROUNDS))

    def lay(ground: WorldBuilder) -> None:
        ground.ramp(length_m, sign * slope_deg, surface).level(1.0, beyond)

    return _Change(lay, {"slope_rad": sign * math.radians(slope_deg), "length_m": length_m})


def _plain(chance: np.random.Generator) -> _Change:
    textures = [str(name) for name in chance.choice(GROUNDS, 2)]

    def lay(ground: WorldBuilder) -> None:
        for texture in textures:
            ground.level(2.2, texture)

    return _Change(lay, {})


def _rough(chance: np.random.Generator) -> _Change:
    rms_m, smooth_m = float(chance.uniform(0.012, 0.05)), float(chance.uniform(0.10, 0.25))
    relief = Relief.of_rms(rms_m, smooth_m, int(chance.integers(1000)))
    plain = _plain(chance)
    return replace(plain, relief=relief, dimensions={"rms_m": rms_m, "smooth_m": smooth_m})


_WITHOUT_PEOPLE = ("above-stairs", "below-stairs", "stairs-down", "step-down", "kerb-down")
"""Who stands, and who goes down: things are drawn over all ground, also over a lip that would hide their feet."""

_DRAWN: dict[str, Callable[[np.random.Generator], _Change]] = {
    "plain": _plain,
    "stairs-up": lambda chance: _flight(chance, 1.0),
    "stairs-down": lambda chance: _flight(chance, -1.0),
    "above-stairs": lambda chance: _flight(chance, -1.0),
    "below-stairs": lambda chance: _flight(chance, 1.0),
    "kerb-up": lambda chance: _edge(chance, 1.0, 0.06, 0.0),
    "kerb-down": lambda chance: _edge(chance, -1.0, 0.06, 0.0),
    "step-up": lambda chance: _edge(chance, 1.0, 0.12, 0.025),
    "step-down": lambda chance: _edge(chance, -1.0, 0.12, 0.025),
    "ramp-up": lambda chance: _ramp(chance, 1.0),
    "ramp-down": lambda chance: _ramp(chance, -1.0),
    "dropped-kerb": _dropped_kerb,
    "rough": _rough,
}
_LONGEST_TREAD_M = 0.5
_SOMEWHERE = WorldBuilder().level(4.0, "concrete").build()
