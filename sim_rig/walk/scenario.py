"""The walks the rig offers, by name: the ground of one lap, the walk over it and the wearer's pace."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from messages import TOPICS, UserError
from sim_rig.imu.drift import NO_DRIFT, Drift
from sim_rig.walk.gait import EVEN, Gait, Habits
from sim_rig.walk.legs import Bend, Leg, Sit, Stand, Turn, Walk, plan
from sim_rig.walk.own_legs import OwnLegs
from sim_rig.walk.passers_by import PassersBy
from sim_rig.walk.polish import Polish
from sim_rig.walk.relief import Relief
from sim_rig.walk.ride import Push, Ride
from sim_rig.walk.standing_things import POSTS, SHOES
from sim_rig.walk.things import BAG, TRAY, TROLLEY, Thing
from sim_rig.walk.walker_ahead import WalkerAhead
from sim_rig.walk.walking_aids import Rollator, WhiteCane
from sim_rig.walk.world import World, WorldBuilder

SPEED_RANGE_MPS = (0.4, 2.0)
CADENCE_RANGE_HZ = (1.0, 2.6)
ACCELERATION_RANGE_MPS2 = (0.5, 2.0)
_STAIR_RISE_M, _STAIR_TREAD_M, _STAIR_STEP_HZ = 0.17, 0.29, 1.6
_SAME_PLACE_M = 1e-6
_FRAME_S = 1e-9 * TOPICS["frame"].period_ns
_USUAL = Habits(step_scatter_s=0.02)


@dataclass(frozen=True)
class Scenario:
    """A repeatable walk. `description` is one line; `legs` walk one lap of `world`, which a `ride` may carry.

    `drift` is what becomes of the chip meanwhile. `things` stand before the ground; `contrast` is that of everything in
    the picture, 1 in good light. The course is turned from the world's x by `course_rad`, > 0 to the left. One that
    `repeats` is made by `repeating`.
    """

    name: str
    description: str
    world: World
    legs: tuple[Leg, ...]
    hip_height_m: float = 0.95
    habits: Habits = EVEN
    ride: Ride | None = None
    drift: Drift = NO_DRIFT
    things: tuple[Thing, ...] = ()
    contrast: float = 1.0
    course_rad: float = 0.0
    repeats: bool = False

    def gait(self, seed: int, start_ns: int) -> Gait:
        """Return the motion of the person whom `seed` draws."""
        return Gait(
            self.world,
            self.legs,
            self.hip_height_m,
            seed,
            start_ns,
            habits=self.habits,
            ride=self.ride,
            course_rad=self.course_rad,
            repeats=self.repeats,
        )


@dataclass(frozen=True)
class Pace:
    """How fast, and with how many steps a second, the wearer walks where the ground does not decide.

    `acceleration_mps2` is the mean one with which the pace is reached; None takes a second.
    Raises UserError where a value is out of its range.
    """

    speed_mps: float = 1.2
    step_hz: float = 1.8
    acceleration_mps2: float | None = None

    def __post_init__(self) -> None:
        for name, value, (low, high), unit in (
            ("speed", self.speed_mps, SPEED_RANGE_MPS, "m/s"),
            ("cadence", self.step_hz, CADENCE_RANGE_HZ, "steps/s"),
            ("acceleration", self.acceleration_mps2, ACCELERATION_RANGE_MPS2, "m/s²"),
        ):
            if value is not None and not low <= value <= high:
                raise UserError(f"{name} is {value} {unit}, allowed is {low} to {high} {unit}")

    def to(self, x_m: float) -> Walk:
        """Return a walk to `x_m` at this pace."""
        return Walk(x_m, self.speed_mps, self.step_hz, self.acceleration_mps2)


_STAIR_PACE = Pace(_STAIR_TREAD_M * _STAIR_STEP_HZ, _STAIR_STEP_HZ)


def mixed(pace: Pace) -> Scenario:
    """Return level ground, ramps, a kerb and stairs, with pauses on several of them."""
    ground = WorldBuilder().level(4.5, "concrete").ramp(4.0, 5.0, "brick").level(2.5, "paving")
    ground.ramp(4.0, -5.0, "brick").level(3.0, "gravel")
    ground.step(0.12, "kerbstone").level(3.5, "paving", "kerb").step(-0.12, "kerbstone").level(4.0, "asphalt")
    stairs_up_m = ground.x_m
    ground.stairs(4, _STAIR_RISE_M, _STAIR_TREAD_M, "kerbstone", "wood").level(2.5, "wood")
    stairs_down_m = ground.x_m
    ground.stairs(4, -_STAIR_RISE_M, _STAIR_TREAD_M, "kerbstone", "wood")
    stairs_end_m = ground.x_m
    ground.level(4.5, "grass").level(3.5, "concrete")
    legs: tuple[Leg, ...] = (
        Stand(2.5),
        pace.to(6.5),
        Stand(2.0),  # on the way up the ramp
        pace.to(16.5),
        Stand(1.5),  # level
        pace.to(stairs_up_m - 0.6),
        Walk(stairs_down_m + 4 * _STAIR_TREAD_M, _STAIR_PACE.speed_mps, _STAIR_PACE.step_hz),
        pace.to(stairs_end_m + 4.0),
        Stand(2.0),  # on grass
        pace.to(ground.x_m),
        Stand(0.5),
    )
    return Scenario("mixed", "level ground, ramps of 5°, a kerb of 12 cm, four stairs, pauses", ground.build(), legs)


def standing(pace: Pace) -> Scenario:  # noqa: ARG001 - one signature for all; who stands has no pace
    """Return a wearer who only stands."""
    world = WorldBuilder().level(4.0, "concrete").level(4.0, "gravel").build()
    return Scenario("standing", "standing still on concrete", world, (Stand(60.0),))


def level(pace: Pace) -> Scenario:
    """Return level ground of many kinds, without a pause after the first one."""
    ground = WorldBuilder()
    for texture in ("concrete", "grass", "paving", "gravel", "asphalt", "brick", "wood"):
        ground.level(4.0, texture)
    legs = (Stand(2.5), pace.to(ground.x_m), Stand(0.5))
    return Scenario("level", "walking over level ground of seven textures", ground.build(), legs)


def ramps(pace: Pace) -> Scenario:
    """Return ramps of 3 to 10°, up and down."""
    ground = WorldBuilder().level(4.0, "concrete")
    for slope_deg, texture in ((3.0, "asphalt"), (5.0, "brick"), (8.0, "gravel"), (10.0, "paving")):
        ground.ramp(4.0, slope_deg, texture).level(2.0, "concrete").ramp(4.0, -slope_deg, texture)
        ground.level(2.5, "grass")
    legs = (Stand(2.5), pace.to(6.5), Stand(2.0), pace.to(ground.x_m), Stand(0.5))
    return Scenario("ramps", "ramps of 3, 5, 8 and 10° up and down, a pause on one", ground.build(), legs)


def start(pace: Pace) -> Scenario:
    """Return a start after 1.5 s, at 1.5 m/s² unless the pace says otherwise."""
    world = WorldBuilder().level(20.0, "concrete").level(22.0, "asphalt").build()
    brisk = pace if pace.acceleration_mps2 is not None else replace(pace, acceleration_mps2=1.5)
    legs = (Stand(1.5), brisk.to(world.length_m), Stand(0.5))
    return Scenario("start", "standing for 1.5 s, then a start at 1.5 m/s²", world, legs, habits=_USUAL)


def stops(pace: Pace) -> Scenario:
    """Return starts and stops of 0.5 to 2 m/s²."""
    ground = WorldBuilder()
    legs: list[Leg] = [Stand(1.5)]
    for acceleration_mps2, texture, pause_s in (
        (0.5, "concrete", 1.0),
        (2.0, "paving", 0.7),
        (0.8, "gravel", 2.0),
        (1.5, "asphalt", 0.5),
    ):
        ground.level(9.0, texture)
        legs += [replace(pace, acceleration_mps2=acceleration_mps2).to(ground.x_m), Stand(pause_s)]
    return Scenario("stops", "starts and stops of 0.5 to 2 m/s²", ground.build(), tuple(legs), habits=_USUAL)


def turns(pace: Pace) -> Scenario:
    """Return half circles walked and turns in place of 90 and 180°."""
    quarter, half = math.radians(90.0), math.radians(180.0)
    legs = (
        Stand(1.5),
        pace.to(5.0),
        replace(pace.to(13.0), turn_rad=half),
        pace.to(21.0),
        replace(pace.to(29.0), turn_rad=half),
        pace.to(32.0),
        Stand(1.0),
        Turn(-quarter, 1.5),
        pace.to(37.0),
        Turn(half, 2.2),
        pace.to(42.0),
        Turn(-quarter, 1.5),
        Stand(0.5),
    )
    return Scenario("turns", "half circles, and turns of 90 and 180° in place", _square(), legs, habits=_USUAL)


def sitting(pace: Pace) -> Scenario:
    """Return a wearer who walks to a seat, turns round, sits down, stands up and walks back."""
    half = math.radians(180.0)
    there = (Stand(1.5), pace.to(5.0), Turn(half, 2.2), Sit(4.0), Stand(0.7))
    back = (pace.to(10.0), Turn(half, 2.2), Stand(1.0))
    return Scenario("sitting", "turning round, sitting down and standing up", _square(), there + back, habits=_USUAL)


def bending(pace: Pace) -> Scenario:
    """Return a wearer who stops twice to pick something up."""
    ground = WorldBuilder().level(9.0, "concrete").level(9.0, "paving")
    legs = (Stand(1.5), pace.to(7.0), Bend(2.0), Stand(0.5), pace.to(11.0), Bend(0.5), pace.to(18.0), Stand(0.5))
    line = "level ground, stopping twice to bend down, for 2 s and for 0.5 s"
    return Scenario("bending", line, ground.build(), legs, habits=_USUAL)


def stumbling(pace: Pace) -> Scenario:
    """Return three stumbles on level ground."""
    world = WorldBuilder().level(15.0, "paving").level(15.0, "grass").build()
    walk = replace(pace.to(world.length_m), stumbles_at_m=(8.0, 14.5, 21.0))
    legs = (Stand(1.5), walk, Stand(0.5))
    return Scenario("stumbling", "level ground with a stumble every 6.5 m", world, legs, habits=_USUAL)


def limping(pace: Pace) -> Scenario:
    """Return a slow walk whose steps differ in time, length and height."""
    world = WorldBuilder().level(15.0, "concrete").level(15.0, "paving").build()
    legs = (Stand(1.5), Walk(world.length_m, 0.7 * pace.speed_mps, 0.8 * pace.step_hz), Stand(0.5))
    habits = replace(_USUAL, limp=1.0)
    return Scenario("limping", "limping on level ground, at 0.7 of the pace", world, legs, habits=habits)


def stairs(pace: Pace) -> Scenario:
    """Return a flight of stairs up and one down."""
    ground = WorldBuilder().level(3.0, "concrete")
    legs: list[Leg] = [Stand(1.5), pace.to(ground.x_m - 1.0)]
    for rise_m, landing, until_m in ((_STAIR_RISE_M, "wood", -1.0), (-_STAIR_RISE_M, "concrete", 0.0)):
        ground.stairs(8, rise_m, _STAIR_TREAD_M, "kerbstone", "wood")
        legs.append(Walk(ground.x_m + 0.5, _STAIR_PACE.speed_mps, _STAIR_PACE.step_hz))
        ground.level(4.5, landing)
        legs.append(pace.to(ground.x_m + until_m))
    legs.append(Stand(0.5))
    return Scenario("stairs", "eight stairs up and eight down", ground.build(), tuple(legs), habits=_USUAL)


def warming(pace: Pace) -> Scenario:
    """Return level ground for a chip that warms up and is carried into the cold."""
    drift = Drift(warming_K=12.0, air_steps=((60.0, -20.0),))
    line = "level ground, the chip warming by 12 K, after a minute in air colder by 20 K"
    return replace(level(pace), name="warming", description=line, drift=drift)


_BUS = Ride(
    (
        Push(6.0, 5.0, ahead_mps2=1.2),
        Push(3.0, 2.5, ahead_mps2=-0.8),
        Push(1.0, 4.5, turn_radps=math.radians(20.0)),
        Push(2.0, 2.5, ahead_mps2=-1.6),
    ),
    rest_s=4.0,
)
_SLOW_BUS = Ride((Push(6.0, 20.0, ahead_mps2=0.3), Push(4.0, 5.0, ahead_mps2=-1.2)), rest_s=4.0)
_LIFT = Ride(
    (
        Push(5.0, 2.0, up_mps2=1.0),
        Push(4.0, 2.0, up_mps2=-1.0),
        Push(5.0, 2.0, up_mps2=-1.0),
        Push(4.0, 2.0, up_mps2=1.0),
    ),
    rest_s=3.0,
)
_RIDES = {
    "bus": (_BUS, "a bus that accelerates at 1.2 m/s² for 5 s, turns at 20 °/s and brakes", 5.0),
    "bus-slow": (_SLOW_BUS, "a bus that accelerates at 0.3 m/s² for 20 s, then brakes", 5.0),
    "lift": (_LIFT, "a lift that goes up and down at 1 m/s²", 2.0),
}


def _standing_in(vehicle: str, pace: Pace) -> Scenario:  # noqa: ARG001 - see `standing`
    ride, line, _ = _RIDES[vehicle]
    return Scenario(vehicle, f"standing in {line}", _square(), (Stand(60.0),), ride=ride)


def _walking_in(vehicle: str, pace: Pace) -> Scenario:
    ride, line, length_m = _RIDES[vehicle]
    half, speed_mps = math.radians(180.0), min(pace.speed_mps, 0.2 * length_m)
    there, back = (Walk(to_m, speed_mps, pace.step_hz) for to_m in (length_m, 2 * length_m))
    legs = (Stand(1.5), there, Turn(half, 2.2), back, Turn(half, 2.2))
    line = f"walking to and fro in {line}"
    return Scenario(f"{vehicle}-walking", line, _square(), legs, habits=_USUAL, ride=ride)


def _square() -> World:
    """Return level ground of several kinds, for those who turn: its length is that of no lap."""
    ground = WorldBuilder()
    for texture in ("concrete", "paving", "gravel", "asphalt"):
        ground.level(5.0, texture)
    return ground.build()


def over_level(
    pace: Pace, name: str, description: str, *textures: str, things: tuple[Thing, ...] = (), contrast: float = 1.0
) -> Scenario:
    """Return a walk over level ground of 4 m of each texture in turn, with things in the picture or in poor light."""
    ground = WorldBuilder()
    for texture in textures or ("concrete", "grass", "paving", "gravel"):
        ground.level(4.0, texture)
    legs = (Stand(2.0), pace.to(ground.x_m), Stand(0.5))
    return Scenario(name, description, ground.build(), legs, things=things, contrast=contrast)


def rough_ground(pace: Pace) -> Scenario:
    """Return level ground with bumps and hollows."""
    walk = over_level(pace, "rough-ground", "bumps and hollows of up to 3 cm, each about 20 cm wide")
    return replace(walk, world=World(walk.world.lap, Relief()))


def polished_floor(pace: Pace) -> Scenario:
    """Return level ground of wood that mirrors the lamps above it."""
    walk = over_level(pace, "polished-floor", "a polished wooden floor that mirrors lamps", "wood")
    return replace(walk, world=World(walk.world.lap, polish=Polish()))


def _mosaic(name: str, description: str) -> Callable[[Pace], Scenario]:
    return lambda pace: over_level(pace, name, description, *[name] * 4)


def _among(name: str, description: str, things: tuple[Thing, ...]) -> Callable[[Pace], Scenario]:
    return lambda pace: over_level(pace, name, description, things=things)


_MAKERS: dict[str, Callable[[Pace], Scenario]] = {
    "mixed": mixed,
    "standing": standing,
    "level": level,
    "ramps": ramps,
    "start": start,
    "stops": stops,
    "turns": turns,
    "sitting": sitting,
    "bending": bending,
    "stumbling": stumbling,
    "limping": limping,
    "stairs": stairs,
    "warming": warming,
    **{vehicle: partial(_standing_in, vehicle) for vehicle in _RIDES},
    **{f"{vehicle}-walking": partial(_walking_in, vehicle) for vehicle in _RIDES},
    "tray": _among("tray", "a patterned board worn ahead, across the upper quarter of the picture", TRAY),
    "trolley": _among("trolley", "a patterned basket on posts, fixed to the wearer ahead", TROLLEY),
    "bag": _among("bag", "a patterned bag at the left side", BAG),
    "rollator": _among("rollator", "a rollator that rolls ahead, with a patterned basket", (Rollator(),)),
    "white-cane": _among("white-cane", "a white cane that sweeps the ground", (WhiteCane(),)),
    "own-legs": _among("own-legs", "the wearer's own legs", (OwnLegs(),)),
    "passers-by": _among("passers-by", "people who cross 1.2 to 2.6 m ahead", (PassersBy(),)),
    "walker-ahead": _among("walker-ahead", "a person who walks 1.5 m ahead", (WalkerAhead(1.5, 0.1),)),
    "posts": _among("posts", "posts that stand beside the middle of the way", (POSTS,)),
    "shoes": _among("shoes", "pairs of shoes that stand beside the middle of the way", (SHOES,)),
    "mosaic-6cm": _mosaic("mosaic-6cm", "square tiles of 6 cm, all alike"),
    "mosaic-2.5cm": _mosaic("mosaic-2.5cm", "square tiles of 2.5 cm, all alike"),
    "mosaic-6cm-varied": _mosaic("mosaic-6cm-varied", "square tiles of 6 cm, their print slightly different"),
    "mosaic-2.5cm-varied": _mosaic("mosaic-2.5cm-varied", "square tiles of 2.5 cm, their print slightly different"),
    "plain-floor": lambda pace: over_level(pace, "plain-floor", "a poured floor, nearly plain", "resin", contrast=0.1),
    "rough-ground": rough_ground,
    "polished-floor": polished_floor,
    "dusk": lambda pace: over_level(
        pace, "dusk", "a tenth of the contrast beside the same noise", "concrete", "paving", contrast=0.1
    ),
}

SCENARIOS: dict[str, str] = {name: make(Pace()).description for name, make in _MAKERS.items()}
"""One line about each scenario, by name."""


def scenario(name: str, pace: Pace | None = None) -> Scenario:
    """Return the scenario called `name`, walked at `pace`. Raises UserError for a name not in SCENARIOS."""
    if name not in _MAKERS:
        raise UserError(f"scenario is '{name}', known are {', '.join(SCENARIOS)}")
    return _MAKERS[name](pace or Pace())


def repeating(walk: Scenario) -> Scenario:
    """Return `walk` with laps that all look alike and take a whole number of frames: it stands longer at their end.

    Raises ValueError where a lap does not end standing, or the next one differs: by its ground, by things or a vehicle.
    """
    *legs, last = walk.legs
    if not isinstance(last, Stand):
        raise ValueError(f"a lap of '{walk.name}' does not end standing")
    world, planned = walk.world, plan(walk.legs)
    ahead_m, left_m = planned.path(planned.lap_s)
    further_m = math.hypot(ahead_m - world.length_m * round(ahead_m / world.length_m), left_m)
    flat = world.relief is None and world.polish is None and walk.course_rad == 0.0
    if further_m > _SAME_PLACE_M or not flat or walk.ride is not None or walk.things or walk.drift != NO_DRIFT:
        raise ValueError(f"no two laps of '{walk.name}' are alike")
    frames = math.ceil(round(planned.lap_s / _FRAME_S, 6))
    longer = Stand(last.duration_s + frames * _FRAME_S - planned.lap_s)
    return replace(walk, legs=(*legs, longer), repeats=True)


def scenario_names(text: str) -> list[str]:
    """Return the names that `level,ramps`, or `all`, stands for. Raises UserError for a name not in SCENARIOS."""
    names = list(SCENARIOS) if text == "all" else text.split(",")
    for name in names:
        scenario(name)
    return names
