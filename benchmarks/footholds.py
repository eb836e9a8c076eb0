"""Where and when feet land, predicted of the hip's motion alone, 250 ms before.

    python -m benchmarks.footholds [--walks terrain speeds stops circles limp] [--seeds 1000-1019]

Each seed is one walk of each kind: `terrain` those of `benchmarks.terrain`; on level ground `speeds` changes its speed
every few metres, each change within a second, `stops` sets off and stops at 2 m/s², `circles` are half circles of 2.5 m
radius at 1.1 m/s, and of a `limp` one foot lands late. Attitudes and velocities are the true ones and so are the edges
of the path, so that a walk takes a second or two; both feet are judged. Seeds below 1000 are for tuning.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from messages import Side
from messages.arrays import FloatArray, IntArray
from messages.constants import NORMAL_95
from perception.attitude.history import AttitudeAt
from perception.gait.gait import Gait
from perception.gait.landing import Landing
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from perception.heading import heading
from perception.terrain.edges import Edge
from perception.terrain.path_ahead import PathAhead
from sim_rig.walk.footholds import Footholds
from sim_rig.walk.gait import Gait as RigGait
from sim_rig.walk.gait import Habits
from sim_rig.walk.legs import Leg, Stand, Walk
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.terrain_walks import STANDING_S, terrain_walk
from sim_rig.walk.world import World, WorldBuilder
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
BEFORE_S = 0.25
_FRAME_ROWS = 5  # of 10 ms
_ROW_NS = 10_000_000
_LEAST_RISE_M = 0.04


class Judged(NamedTuple):
    """Errors of one landing, ahead (m), to the left (m) and in time (s), and one σ of each that was stated."""

    errors: FloatArray
    sds: FloatArray


def landings(seed: int, scenario: Scenario, seconds: float) -> Iterator[Judged | None]:
    """Yield each landing of a walk once it has begun; None where no landing was said."""
    calibration = SimulatedWearer(seed, scenario, START_NS).calibration
    R_BC = GroundEstimator(calibration, FootholdSettings()).R_BC
    p_BC_m = np.array(calibration.X_BE.p_m)
    rig = scenario.gait(seed, START_NS)
    footholds = Footholds(scenario.world, rig, seed)
    t_ns, attitudes = _attitudes(rig, seconds)
    gait, told = Gait(calibration, R_BC, Side.RIGHT), attitudes.get
    frames_ns = t_ns[::_FRAME_ROWS]
    strikes_ns = START_NS + np.round(1e9 * rig.strike_s).astype(np.int64)
    for frame_ns in frames_ns.tolist():
        placed = attitudes[frame_ns]
        p_WC = np.array(rig.at(np.array([frame_ns])).p_WB_m[0]) + placed.R_WB @ p_BC_m
        R_WH = heading(placed.R_WB @ R_BC)
        steps = gait.add_frame(placed, told, PathAhead(_edges(scenario.world, p_WC, R_WH)))
        since_s = 1e-9 * (strikes_ns - frame_ns) - BEFORE_S
        due = (since_s >= 0.0) & (since_s < 1e-9 * _FRAME_ROWS * _ROW_NS)
        if frame_ns < START_NS + 1e9 * STANDING_S or R_WH is None or not due.any():
            continue
        true = footholds.next_after(int(strikes_ns[due][0]) - 1)
        said = None if true is None else steps.other if true.left else steps.prosthetic
        if true is None or said is None:
            yield None
            continue
        ahead_m, left_m, _ = R_WH.T @ (true.p_WF_m - p_WC)
        yield _judged(said, ahead_m, left_m, 1e-9 * (true.t_land_ns - frame_ns))


def _judged(said: Landing, ahead_m: float, left_m: float, in_s: float) -> Judged:
    errors = np.array([said.ahead_m - ahead_m, said.left_m - left_m, said.time_s - in_s])
    return Judged(errors, np.array([said.ahead_sd_m, said.left_sd_m, said.time_sd_s]))


def _attitudes(rig: RigGait, seconds: float) -> tuple[IntArray, dict[int, AttitudeAt]]:
    """Return the times (n,) and the true attitude at each."""
    t_ns = START_NS + _ROW_NS * np.arange(round(1e9 * seconds / _ROW_NS))
    motion = rig.at(t_ns)
    q = Rotation.from_matrix(motion.R_WB).as_quat(canonical=True)[:, [3, 0, 1, 2]]
    rows = zip(t_ns.tolist(), q.tolist(), motion.w_WB_B_radps.tolist(), motion.v_WB_mps.tolist(), strict=True)
    return t_ns, {t: AttitudeAt(t, tuple(q), tuple(w), 0.0, np.zeros((3, 3)), tuple(v)) for t, q, w, v in rows}


def _edges(world: World, p_WC_m: FloatArray, R_WH: FloatArray | None) -> tuple[Edge, ...]:
    """Return the edges from 0.3 m behind the camera to 1.8 m before it."""
    if R_WH is None or R_WH[0, 0] <= 0.0:
        return ()
    along, yaw_rad = float(R_WH[0, 0]), -math.atan2(R_WH[1, 0], R_WH[0, 0])
    pieces = world.between(p_WC_m[0] - 0.3, p_WC_m[0] + 1.8)
    return tuple(
        Edge(float(piece.lip_x_m - p_WC_m[0]) / along, 0.01, piece.z1_m - piece.z0_m, 0.005, yaw_rad, 0.01)
        for piece in pieces
        if piece.is_riser and abs(piece.z1_m - piece.z0_m) >= _LEAST_RISE_M
    )


def _terrain(seed: int) -> tuple[Scenario, float]:
    walk = terrain_walk(seed)
    return walk.scenario, walk.seconds


def _level(legs: tuple[Leg, ...], limp: float = 0.0) -> tuple[Scenario, float]:
    world = WorldBuilder().level(60.0, "concrete").build()
    habits = Habits(limp=limp, step_scatter_s=0.015)
    scenario = Scenario("level", "level ground", world, (Stand(STANDING_S), *legs, Stand(0.5)), 0.9, habits=habits)
    return scenario, scenario.gait(0, START_NS).lap_s


def _speeds(seed: int) -> tuple[Scenario, float]:
    chance = np.random.default_rng([seed, 40])
    to_m = np.cumsum(chance.uniform(2.5, 4.0, 8))
    paces = [(float(v), float((0.95 + 0.7 * v) * chance.uniform(0.9, 1.1))) for v in chance.uniform(0.5, 1.6, 8)]
    return _level(tuple(Walk(float(to), v, hz) for to, (v, hz) in zip(to_m, paces, strict=True)))


def _stops(seed: int) -> tuple[Scenario, float]:
    chance = np.random.default_rng([seed, 41])
    to_m, speeds = np.cumsum(chance.uniform(3.5, 5.0, 6)), chance.uniform(0.9, 1.5, 6)
    legs: list[Leg] = []
    for to, v in zip(to_m.tolist(), speeds.tolist(), strict=True):
        legs += [Walk(to, v, 0.95 + 0.7 * v, acceleration_mps2=2.0), Stand(0.6)]
    return _level(tuple(legs))


def _circles(seed: int) -> tuple[Scenario, float]:
    way = math.copysign(2.5 * math.pi, 0.5 - seed % 2)
    ends_m = np.cumsum([3.0, abs(way), 5.0, abs(way), 4.0])
    turns = (0.0, math.copysign(math.pi, way), 0.0, math.copysign(math.pi, way), 0.0)
    return _level(tuple(Walk(float(to), 1.1, 1.72, turn_rad=turn) for to, turn in zip(ends_m, turns, strict=True)))


def _limp(seed: int) -> tuple[Scenario, float]:
    return _level((Walk(18.0, 1.1, 1.72),), limp=float(np.random.default_rng([seed, 42]).uniform(0.4, 1.0)))


WALKS: dict[str, Callable[[int], tuple[Scenario, float]]] = {
    "terrain": _terrain,
    "speeds": _speeds,
    "stops": _stops,
    "circles": _circles,
    "limp": _limp,
}


def report(name: str, found: list[Judged | None]) -> None:
    """Print the figures of one kind of walk."""
    told = [each for each in found if each is not None]
    errors, sds = (np.array([each[k] for each in told]) for k in (0, 1))
    parts = [
        f"{what} MAE {1e3 * np.abs(e).mean():.1f} {unit}, P95 {1e3 * np.quantile(np.abs(e), 0.95):.0f}, "
        f"mean {1e3 * e.mean():+.1f}, 95 % hold {np.mean(np.abs(e) <= NORMAL_95 * sd):.1%}"
        for what, unit, e, sd in zip(("ahead", "left", "time"), ("mm", "mm", "ms"), errors.T, sds.T, strict=True)
    ]
    print(f"{name}: said {len(told)} of {len(found)}; {'; '.join(parts)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--walks", nargs="+", default=list(WALKS), choices=list(WALKS))
    parser.add_argument("--seeds", default="1000-1019", help="first-last")
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    for name in options.walks:
        report(name, [each for seed in range(first, last + 1) for each in landings(seed, *WALKS[name](seed))])


if __name__ == "__main__":
    main()
