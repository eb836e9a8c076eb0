"""The truth about the ground ahead against rays followed in small steps, and against feet as they are drawn."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from messages.arrays import BoolArray, FloatArray
from perception.depth.rectify import intrinsics
from sim_rig.walk.legs import Stand, Walk
from sim_rig.walk.own_legs import TOE_AHEAD_M, OwnLegs
from sim_rig.walk.relief import Relief
from sim_rig.walk.scenario import Scenario, scenario
from sim_rig.walk.terrain_truth import FARTHEST_M, TerrainTruth
from sim_rig.walk.things import Walker
from sim_rig.walk.walker_ahead import WalkerAhead
from sim_rig.walk.world import World, WorldBuilder
from sim_rig.wearer import SimulatedWearer

START_NS = 5_000_000_000


def closed(ground: WorldBuilder) -> World:
    """Return the world that comes back to its first height by a ramp far behind."""
    ground.level(6.0, "wood")
    if ground.z_m:
        ground.ramp(10.0, -math.degrees(math.atan(ground.z_m / 10.0)), "wood")
    return ground.level(6.0, "wood").build()


def stairs(at_m: float, rise_m: float, nosing_m: float = 0.0) -> World:
    return closed(WorldBuilder().level(at_m, "concrete").stairs(4, rise_m, 0.28, "wood", "wood", nosing_m))


def standing(world: World, course_rad: float = 0.0) -> SimulatedWearer:
    walk = Scenario("here", "", world, (Stand(60.0),), hip_height_m=0.9, course_rad=course_rad)
    return SimulatedWearer(3, walk, START_NS)


def truth(wearer: SimulatedWearer, k: int = 20) -> TerrainTruth:
    return wearer.terrain(wearer.shutter.header(k).t_exposure_ns)


def eye(wearer: SimulatedWearer, t_ns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the left optical centre, R_WL and H's x in W, by way of the calibration's own axes."""
    motion, unit = wearer.gait.at(np.array([t_ns])), wearer.unit
    R_WL = motion.R_WB[0] @ np.array(unit.X_BL.R)
    o_W = motion.p_WB_m[0] + motion.R_WB[0] @ np.array(unit.X_BL.p_m)
    (width, height), K = (1280, 720), intrinsics(unit.stereo.left)
    R_RL, p = np.array(unit.stereo.X_RL.R), np.array(unit.stereo.X_RL.p_m).reshape(3, 1)
    distortions = [np.array(lens.distortion) for lens in (unit.stereo.left, unit.stereo.right)]
    K_right = intrinsics(unit.stereo.right)
    R_CL = cv2.stereoRectify(K, distortions[0], K_right, distortions[1], (width, height), R_RL, p, alpha=0)[0]
    ahead = R_WL @ R_CL[2]
    return o_W, R_WL, ahead[:2] / np.hypot(*ahead[:2])


def solid(world: World, x: FloatArray, z: FloatArray) -> BoolArray:
    """Return whether points (n,) lie inside the ground: below it, and not in the air under a nosing."""
    inside: BoolArray = z < world.heights(x)
    for piece in world.lap:
        if piece.is_riser and piece.x0_m != piece.x1_m:
            share = (z - piece.z0_m) / (piece.z1_m - piece.z0_m)
            face = piece.x0_m + share * (piece.x1_m - piece.x0_m)
            beside = (x > piece.x1_m) & (x < piece.x0_m) & (share > 0) & (share < 1)
            inside &= ~(beside & (x < face if piece.z1_m > piece.z0_m else x > face))
    return inside


def followed(wearer: SimulatedWearer, x: float, z: float) -> bool:
    """Return whether the left camera sees the path's point at x and z of W: its line of sight in small steps."""
    t_ns = wearer.shutter.true_of(wearer.shutter.header(20).t_exposure_ns)
    o_W, R_WL, ahead = eye(wearer, t_ns)
    d = (x - o_W[0]) / ahead[0]
    point = np.array([*(o_W[:2] + d * ahead), z])
    lens = wearer.unit.stereo.left
    pixel = cv2.projectPoints(
        (point - o_W) @ R_WL, np.zeros(3), np.zeros(3), intrinsics(lens), np.array(lens.distortion)
    )
    u, v = pixel[0].ravel()
    if not (0 <= u < 1280 and 0 <= v < 720):
        return False
    steps = int(np.linalg.norm(point - o_W) / 0.0005)
    way = o_W + np.linspace(0.0, 1.0, steps)[: steps - 4, None] * (point - o_W)
    return not solid(wearer.scenario.world, way[:, 0], way[:, 2]).any()


@pytest.mark.parametrize("nosing_m", [0.0, 0.025])
@pytest.mark.parametrize("course_rad", [0.0, -0.5])
@pytest.mark.parametrize("at_m", [0.6, 1.1, 1.9])
def test_as_much_of_a_riser_is_visible_as_its_lines_of_sight_reach(
    at_m: float, course_rad: float, nosing_m: float
) -> None:
    wearer = standing(stairs(at_m, 0.17, nosing_m), course_rad)
    found = truth(wearer)
    risers = [piece for piece in wearer.scenario.world.lap if piece.is_riser]
    for edge, riser in zip(found.edges, risers, strict=False):
        shares = np.linspace(0.02, 0.98, 25)
        face = [(riser.x0_m + s * (riser.x1_m - riser.x0_m), riser.z0_m + s * 0.17) for s in shares]
        seen = np.mean([followed(wearer, x - 1e-4, z) for x, z in face])
        assert edge.visible == pytest.approx(seen, abs=0.08)
    assert at_m > 1.5 or found.edges[0].visible > 0.9


@pytest.mark.parametrize("nosing_m", [0.0, 0.025])
@pytest.mark.parametrize("course_rad", [0.0, 0.5])
def test_as_much_is_visible_behind_a_lip_as_lines_of_sight_reach(course_rad: float, nosing_m: float) -> None:
    wearer = standing(stairs(0.62 * math.cos(course_rad), -0.17, nosing_m), course_rad)
    found = truth(wearer)
    _, _, ahead = eye(wearer, wearer.shutter.true_of(wearer.shutter.header(20).t_exposure_ns))
    assert len(found.edges) == 4
    for edge, following in zip(found.edges[:3], found.edges[1:], strict=True):
        distances = np.arange(edge.distance_m + 0.005, following.distance_m - 0.001, 0.01)
        x = [found.x_W_m + d * ahead[0] for d in distances]
        z_m = wearer.scenario.world.segment_at(x[-1]).z0_m
        seen = 0.01 * sum(followed(wearer, each, z_m + 1e-4) for each in x)
        assert edge.visible == pytest.approx(seen, abs=0.025)
    assert 0.05 < found.edges[0].visible < 0.25


@pytest.mark.parametrize("course_rad", [0.0, 0.5])
def test_edges_are_where_the_path_meets_them(course_rad: float) -> None:
    wearer = standing(stairs(0.8, 0.16, 0.02), course_rad)
    found = truth(wearer)
    o_W, _, ahead = eye(wearer, found.t_true_ns)
    for k, edge in enumerate(found.edges):
        assert o_W[0] + edge.distance_m * ahead[0] == pytest.approx(0.78 + 0.28 * k, abs=1e-6)
        assert edge.rise_m == pytest.approx(0.16)
        # points of the edge, x = const in W, lie in H on the line (x − d) cos yaw + y sin yaw = 0
        for y in (-0.4, 0.7):
            point = np.array([0.78 + 0.28 * k, y]) - o_W[:2]
            x_H, y_H = point @ ahead, point @ (-ahead[1], ahead[0])
            assert (x_H - edge.distance_m) * math.cos(edge.yaw_rad) + y_H * math.sin(edge.yaw_rad) == pytest.approx(
                0.0, abs=1e-6
            )
    assert found.edges[0].yaw_rad == pytest.approx(-course_rad, abs=0.2)
    assert found.foothold is None
    assert found.surface is None


@pytest.mark.parametrize(
    ("world", "kind"),
    [
        (closed(WorldBuilder().level(6.0, "wood")), "level"),
        (stairs(0.6, 0.17), "stairs_up"),
        (stairs(0.6, -0.17), "stairs_down"),
        (stairs(2.2, -0.17), "level"),
        (closed(WorldBuilder().level(0.7, "wood").step(0.1, "wood")), "step_up"),
        (closed(WorldBuilder().level(0.7, "wood").step(-0.1, "wood")), "step_down"),
        (closed(WorldBuilder().level(1.5, "wood").step(-0.1, "wood")), "level"),
        (closed(WorldBuilder().level(0.5, "wood").ramp(2.0, 6.0, "wood")), "ramp_up"),
        (closed(WorldBuilder().level(0.5, "wood").ramp(2.0, -6.0, "wood")), "ramp_down"),
        (closed(WorldBuilder().level(0.9, "wood").ramp(2.0, -6.0, "wood")), "level"),
        (WorldBuilder().level(8.0, "wood").build(Relief.of_rms(0.03, 0.15, 1)), "rough"),
    ],
)
def test_the_kind_is_that_of_most_of_the_path(world: World, kind: str) -> None:
    assert truth(standing(world)).kind == kind


def test_a_walker_ahead_hides_what_is_behind() -> None:
    world = stairs(1.4, 0.17)
    alone, behind = standing(world), standing(world)
    ahead = WalkerAhead(1.0, 0.16)
    walk = dataclasses.replace(behind.scenario, things=(ahead,))
    hidden = truth(SimulatedWearer(3, walk, START_NS))
    assert hidden.edges[0].distance_m == truth(alone).edges[0].distance_m
    assert hidden.edges[0].visible < truth(alone).edges[0].visible


def test_nothing_is_in_view_behind_a_lip_at_the_end_of_the_path() -> None:
    here = truth(standing(stairs(2.0, -0.17)))
    found = truth(standing(stairs(here.x_W_m + (FARTHEST_M - 0.001) * here.way_m, -0.17)))
    (edge,) = found.edges
    assert edge.distance_m == pytest.approx(FARTHEST_M - 0.001, abs=1e-4)
    assert edge.visible == 0.0


def test_toes_and_contacts_are_those_of_the_feet_that_are_drawn() -> None:
    world = closed(WorldBuilder().level(4.0, "wood").step(0.12, "wood"))
    walk = Scenario("kerb", "", world, (Stand(1.0), Walk(world.length_m, 1.1, 1.7), Stand(0.5)), course_rad=0.0)
    wearer = SimulatedWearer(4, walk, START_NS)
    seen = [wearer.terrain(wearer.shutter.header(k).t_exposure_ns) for k in range(40, 100, 4)]
    edge = next(truth.edges[0] for truth in seen if truth.edges)
    walker = Walker(wearer.gait, world, 4)
    assert edge.t_toe_ns is not None
    assert edge.t_contact_ns is not None

    def toe_x(t_ns: int) -> float:
        instants = np.array([t_ns])
        feet = [p for p in OwnLegs().placed(walker, instants, wearer.gait.at(instants)) if p.block.size_m[2] == 0.08]
        return max(float(foot.p_WT_m[0, 0]) for foot in feet) + TOE_AHEAD_M

    assert toe_x(edge.t_toe_ns) == pytest.approx(
        4.0 - 0.6, abs=0.05
    )  # the block of a foot that is tipped is off the sole
    assert toe_x(edge.t_toe_ns - 120_000_000) < 4.0 - 0.6 - 0.05
    landing = wearer.footholds.last_before(edge.t_contact_ns)
    assert landing is not None
    assert landing.t_land_ns == edge.t_contact_ns
    assert landing.p_WF_m[0] > 4.0
    before = wearer.footholds.last_before(edge.t_contact_ns - 1000)
    assert before is not None
    assert before.p_WF_m[0] < 4.0


def test_the_surface_is_that_under_the_next_foot() -> None:
    walk = scenario("mixed")
    wearer = SimulatedWearer(2, walk, START_NS)
    for k in range(80, 560, 40):
        found = truth(wearer, k)
        assert found.foothold is not None
        assert found.surface is not None
        assert found.surface.below_m == pytest.approx(found.foothold.below_m, abs=1e-6)
        assert found.surface.slope_sagittal_rad == pytest.approx(found.foothold.slope_sagittal_rad)
        assert found.surface.slope_frontal_rad == pytest.approx(found.foothold.slope_frontal_rad)
