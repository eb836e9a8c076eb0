"""What a wearer does, leg after leg, and the plan of one lap that follows from it: polynomials in time."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import PPoly, make_interp_spline

from messages.arrays import FloatArray
from sim_rig.walk.ramps import SMOOTHSTEP, Change, ramped

_PACE_CHANGE_S = 1.0
_LEAST_PACE_CHANGE_S = 0.3

_TURNING_FADE = 0.5  # who turns in place makes small steps
_TURNING_STEP_HZ = 1.8
_TURNING_BLEND_S = 0.4

_SIT_S = 2.0
_SEAT_SINK_M, _SEAT_BACK_M = 0.40, 0.25
_SEAT_LEAN_RAD, _SEATED_LEAN_RAD = np.deg2rad((35.0, 5.0))
_SEAT_BENT_S = 0.9  # until the trunk leans forward most
_SEAT_SINK_AFTER_S = 0.4

_BEND_S = 1.2
_BEND_LEAN_RAD = float(np.deg2rad(30.0))  # of the pelvis, on which the camera sits; the back bends further
_BEND_SINK_M, _BEND_BACK_M = 0.12, 0.10

_TRIP_S, _RECOVERY_S = 0.15, 0.35
_TRIP_LEAN_RAD = float(np.deg2rad(14.0))
_TRIP_SINK_M, _TRIP_BACK_M = 0.03, 0.03

_PATH_GRID_S = 0.002
_PATH_KNOT_EVERY = 5


@dataclass(frozen=True)
class Walk:
    """Walk on until `to_m` of the lap's way are behind, at `speed_mps` with `step_hz` steps a second.

    On a lap without turns the way is x. Speed, cadence and the amplitudes of the gait come to their values, and to
    rest before a stop, together: speed at a mean of `acceleration_mps2` where it is given, else within a second. At
    full pace the way bends by `turn_rad` in all (> 0 to the left), and the wearer stumbles at each of `stumbles_at_m`.
    """

    to_m: float
    speed_mps: float
    step_hz: float
    acceleration_mps2: float | None = None
    turn_rad: float = 0.0
    stumbles_at_m: tuple[float, ...] = ()

    def pace_change_s(self, from_mps: float, to_mps: float) -> float:
        """Return how long a change of speed takes."""
        if self.acceleration_mps2 is None:
            return _PACE_CHANGE_S
        return max(abs(to_mps - from_mps) / self.acceleration_mps2, _LEAST_PACE_CHANGE_S)


@dataclass(frozen=True)
class Stand:
    """Stand still."""

    duration_s: float


@dataclass(frozen=True)
class Turn:
    """Turn in place by `turn_rad` (> 0 to the left) with small steps."""

    turn_rad: float
    duration_s: float


@dataclass(frozen=True)
class Sit:
    """Sit down, remain seated for `seated_s`, stand up.

    The hip sinks by 0.4 m; the trunk leans forward by 35° on the way down and on the way up.
    """

    seated_s: float


@dataclass(frozen=True)
class Bend:
    """Bend down as to pick something up, remain so for `held_s`, straighten.

    The hip sinks by 0.12 m and goes back by 0.1 m; the pelvis leans forward by 30°.
    """

    held_s: float


Leg = Walk | Stand | Turn | Sit | Bend


@dataclass(frozen=True)
class Plan:
    """One lap, as polynomials in time.

    `pace` is the way walked (m), the step phase (cycles) and the fade (0 standing, 1 walking); `path` x and y (m).
    Beside them how far the heading is turned to the left and the trunk leans forward (rad), and how far the hip has
    sunk and gone back (m).
    """

    pace: PPoly
    path: PPoly
    heading: PPoly
    lean: PPoly
    sink: PPoly
    back: PPoly

    @property
    def lap_s(self) -> float:
        """Return how long a lap takes."""
        return float(self.pace.x[-1])


def plan(legs: tuple[Leg, ...]) -> Plan:
    """Return the plan of one lap, in which the distance is three times continuously differentiable.

    Raises ValueError where a leg is too short for its changes, or the lap does not end with the heading it began with.
    """
    planner = _Planner()
    for leg, following in zip(legs, (*legs[1:], None), strict=True):
        planner.add(leg, stops=following is not None and not isinstance(following, Walk))
    return planner.plan()


class _Planner:
    """Puts one leg after another, from a standing start on."""

    def __init__(self) -> None:
        self._durations: list[float] = []
        self._ends: list[tuple[FloatArray, FloatArray]] = []
        self._t_s = 0.0
        self._way_m = 0.0
        self._rates = np.zeros(3)  # speed, cadence, fade
        self._heading: list[Change] = []
        self._lean: list[Change] = []
        self._sink: list[Change] = []
        self._back: list[Change] = []

    def add(self, leg: Leg, *, stops: bool) -> None:
        """Add one leg; one that walks `stops` before what follows it."""
        if isinstance(leg, Stand):
            self._keep(leg.duration_s)
        elif isinstance(leg, Walk):
            self._walk(leg, stops)
        elif isinstance(leg, Turn):
            self._turn(leg)
        elif isinstance(leg, Sit):
            self._sit(leg)
        else:
            self._bend(leg)

    def plan(self) -> Plan:
        """Return the plan of all legs so far."""
        pace = self._pace()
        heading = ramped(self._heading, self._t_s)
        turned = float(heading(self._t_s)) / (2 * np.pi)
        if abs(turned - round(turned)) > 1e-9:
            raise ValueError(f"a lap turns the wearer by {360 * turned:.1f}° in all, must be whole turns")
        return Plan(
            pace=pace,
            path=_curved(pace, heading) if self._heading else _straight(pace),
            heading=heading,
            lean=ramped(self._lean, self._t_s),
            sink=ramped(self._sink, self._t_s),
            back=ramped(self._back, self._t_s),
        )

    def _pace(self) -> PPoly:
        durations = self._durations
        knots = np.concatenate(([0.0], np.cumsum(durations)))
        rate_c = np.zeros((6, len(durations), 3))
        for k, (duration_s, (before, after)) in enumerate(zip(durations, self._ends, strict=True)):
            rate_c[:, k] = np.outer(np.array(SMOOTHSTEP) / duration_s ** np.arange(5, -1, -1), after - before)
            rate_c[5, k] += before
        travelled = PPoly(rate_c[:, :, :2], knots).antiderivative()
        fade_c = np.concatenate((np.zeros((1, len(durations), 1)), rate_c[:, :, 2:]))
        return PPoly(np.concatenate((travelled.c, fade_c), axis=2), knots)

    def _change_to(self, rates: FloatArray, duration_s: float) -> None:
        self._durations.append(duration_s)
        self._ends.append((self._rates, rates))
        self._t_s += duration_s
        self._rates = rates

    def _keep(self, duration_s: float) -> None:
        self._change_to(self._rates, duration_s)

    def _walk(self, leg: Walk, stops: bool) -> None:
        wanted = np.array([leg.speed_mps, leg.step_hz, 1.0])
        before_mps = float(self._rates[0])
        begin_s, end_s = leg.pace_change_s(before_mps, leg.speed_mps), leg.pace_change_s(leg.speed_mps, 0.0)
        stopping_m = 0.5 * end_s * leg.speed_mps if stops else 0.0
        begin_m = 0.5 * begin_s * (before_mps + leg.speed_mps)
        cruise_m = leg.to_m - self._way_m - begin_m - stopping_m
        if cruise_m < 0:
            raise ValueError(f"walk to {leg.to_m} m is {-cruise_m:.2f} m too short to change pace")
        self._change_to(wanted, begin_s)
        cruise_s = cruise_m / leg.speed_mps
        for at_m in leg.stumbles_at_m:
            self._stumble(self._t_s + (at_m - self._way_m - begin_m) / leg.speed_mps)
        if leg.turn_rad:
            self._heading.append(Change(self._t_s, cruise_s, leg.turn_rad))
        self._keep(cruise_s)
        if stops:
            self._change_to(np.zeros(3), end_s)
        self._way_m = leg.to_m

    def _stumble(self, t_s: float) -> None:
        for changes, by in (
            (self._lean, _TRIP_LEAN_RAD),
            (self._sink, _TRIP_SINK_M),
            (self._back, _TRIP_BACK_M),
        ):
            changes += [Change(t_s, _TRIP_S, by), Change(t_s + _TRIP_S, _RECOVERY_S, -by)]

    def _turn(self, leg: Turn) -> None:
        steady_s = leg.duration_s - 2 * _TURNING_BLEND_S
        if steady_s <= 0:
            raise ValueError(f"a turn takes {leg.duration_s} s, must be more than {2 * _TURNING_BLEND_S} s")
        self._heading.append(Change(self._t_s, leg.duration_s, leg.turn_rad))
        self._change_to(np.array([0.0, _TURNING_STEP_HZ, _TURNING_FADE]), _TURNING_BLEND_S)
        self._keep(steady_s)
        self._change_to(np.zeros(3), _TURNING_BLEND_S)

    def _sit(self, leg: Sit) -> None:
        down_s, up_s = self._t_s, self._t_s + _SIT_S + leg.seated_s
        bent, sinking_s = _SEAT_LEAN_RAD - _SEATED_LEAN_RAD, _SIT_S - _SEAT_SINK_AFTER_S
        self._lean += [
            Change(down_s, _SEAT_BENT_S, _SEAT_LEAN_RAD),
            Change(down_s + _SEAT_BENT_S, _SIT_S - _SEAT_BENT_S, -bent),
            Change(up_s, _SEAT_BENT_S, bent),
            Change(up_s + _SEAT_BENT_S, _SIT_S - _SEAT_BENT_S, -_SEAT_LEAN_RAD),
        ]
        self._sink += [
            Change(down_s + _SEAT_SINK_AFTER_S, sinking_s, _SEAT_SINK_M),
            Change(up_s, sinking_s, -_SEAT_SINK_M),
        ]
        self._back += [Change(down_s, _SIT_S, _SEAT_BACK_M), Change(up_s, _SIT_S, -_SEAT_BACK_M)]
        self._keep(2 * _SIT_S + leg.seated_s)

    def _bend(self, leg: Bend) -> None:
        down_s, up_s = self._t_s, self._t_s + _BEND_S + leg.held_s
        for changes, by in (
            (self._lean, _BEND_LEAN_RAD),
            (self._sink, _BEND_SINK_M),
            (self._back, _BEND_BACK_M),
        ):
            changes += [Change(down_s, _BEND_S, by), Change(up_s, _BEND_S, -by)]
        self._keep(2 * _BEND_S + leg.held_s)


def _straight(pace: PPoly) -> PPoly:
    way_c = pace.c[:, :, :1]
    return PPoly(np.concatenate((way_c, np.zeros_like(way_c)), axis=2), pace.x)


def _curved(pace: PPoly, heading: PPoly) -> PPoly:
    """Return x and y of a way walked along `heading`, as quintic splines."""
    count = _PATH_KNOT_EVERY * round(pace.x[-1] / _PATH_GRID_S / _PATH_KNOT_EVERY)
    t = np.linspace(0.0, pace.x[-1], count + 1)
    speed, psi = pace.derivative(1)(t)[:, 0], heading(t)
    velocity = np.stack((speed * np.cos(psi), speed * np.sin(psi)), axis=1)
    path = cumulative_simpson(velocity, x=t, axis=0, initial=0.0)
    splines = [make_interp_spline(t[::_PATH_KNOT_EVERY], each[::_PATH_KNOT_EVERY], k=5) for each in path.T]
    curves = [PPoly.from_spline((spline.t, spline.c, spline.k)) for spline in splines]
    curved: PPoly = PPoly(np.stack([curve.c for curve in curves], axis=2), curves[0].x)
    return curved
