"""The walks the rig offers, by name: the ground of one lap, the walk over it and the wearer's pace."""

from dataclasses import dataclass

from messages import UserError
from sim_rig.walk.gait import Leg, Stand, Walk
from sim_rig.walk.world import World, WorldBuilder

SPEED_RANGE_MPS = (0.4, 2.0)
CADENCE_RANGE_HZ = (1.0, 2.6)
_STAIR_RISE_M, _STAIR_TREAD_M, _STAIR_STEP_HZ = 0.17, 0.29, 1.6


@dataclass(frozen=True)
class Scenario:
    """A repeatable walk. `description` is one line; `legs` walk one lap of `world`."""

    name: str
    description: str
    world: World
    legs: tuple[Leg, ...]
    hip_height_m: float = 0.95


@dataclass(frozen=True)
class Pace:
    """How fast, and with how many steps a second, the wearer walks where the ground does not decide.

    Raises UserError where a value is out of its range.
    """

    speed_mps: float = 1.2
    step_hz: float = 1.8

    def __post_init__(self) -> None:
        for name, value, (low, high), unit in (
            ("speed", self.speed_mps, SPEED_RANGE_MPS, "m/s"),
            ("cadence", self.step_hz, CADENCE_RANGE_HZ, "steps/s"),
        ):
            if not low <= value <= high:
                raise UserError(f"{name} is {value} {unit}, allowed is {low} to {high} {unit}")

    def to(self, x_m: float) -> Walk:
        """Return a walk to `x_m` at this pace."""
        return Walk(x_m, self.speed_mps, self.step_hz)


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


_MAKERS = {"mixed": mixed, "standing": standing, "level": level, "ramps": ramps}

SCENARIOS: dict[str, str] = {name: make(Pace()).description for name, make in _MAKERS.items()}
"""One line about each scenario, by name."""


def scenario(name: str, pace: Pace | None = None) -> Scenario:
    """Return the scenario called `name`, walked at `pace`. Raises UserError for a name not in SCENARIOS."""
    if name not in _MAKERS:
        raise UserError(f"scenario is '{name}', known are {', '.join(SCENARIOS)}")
    return _MAKERS[name](pace or Pace())
