"""What is said of one frame as lines in H: for a picture (`drawing`) and for a scene in space (`cli.scene`)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cli.overlay.lettering import Colour
from cli.overlay.projection import Sight
from messages import GroundPlane, NextFoothold, Status, Terrain, TerrainEdge, TerrainObstacle
from messages.arrays import FloatArray
from perception.ground.foothold import FootholdSettings
from perception.terrain.surfaces import PathSurfaces

REGION: Colour = (80, 220, 80)
SURFACE: Colour = (230, 190, 60)
UP: Colour = (60, 170, 255)
DOWN: Colour = (230, 110, 255)
OBSTACLE: Colour = (70, 70, 255)
FOOT: Colour = (90, 255, 255)
PATH_HALF_WIDTH_M = 0.25


@dataclass(frozen=True)
class Said:
    """What was said of one frame. `sight` is None where its attitude is not valid; `surfaces` are the path's."""

    t_s: float
    ground: GroundPlane
    terrain: Terrain | None
    surfaces: PathSurfaces
    sight: Sight | None


class Shape(NamedTuple):
    """Lines from corner to corner, each (n, 3) in H; of a `filled` one the only line is the outline of an area.

    `what` is the kind of thing, `width` that of a line in pixels of a picture 640 px wide.
    """

    what: str
    lines: Sequence[FloatArray]
    colour: Colour
    width: int
    filled: bool = False
    label: str = ""


def shapes(said: Said, region: FootholdSettings) -> Iterator[Shape]:
    """Yield what was `said` of a frame, what lies below first. `region` is that of the ground."""
    yield from _surfaces(said.surfaces)
    if said.ground.status is Status.VALID:
        yield from _region(said.ground, region)
    if said.terrain is not None:
        yield from _edges(said.terrain.edges, said.surfaces)
        yield from _obstacles(said.terrain.obstacles, said.surfaces)
        yield from _foothold(said.terrain.foothold)


def _surfaces(path: PathSurfaces) -> Iterator[Shape]:
    """Yield the outline of each surface of the path."""
    for surface in path.surfaces:
        u = np.array([surface.from_m, surface.to_m, surface.to_m, surface.from_m, surface.from_m])
        y = PATH_HALF_WIDTH_M * np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
        yield Shape("surface", [path.points_H(surface, u, y)], SURFACE, 1, filled=True)


def _region(ground: GroundPlane, region: FootholdSettings) -> Iterator[Shape]:
    """Yield the region of the ground, ruled, on the plane that was found in it."""
    a, b = math.tan(ground.slope_sagittal_rad), math.tan(ground.slope_frontal_rad)

    def on_plane(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.column_stack((x, y, a * x + b * y - ground.height_m))

    ends, across = np.array([-1.0, 1.0]), np.ones(2)
    for k in np.linspace(-1.0, 1.0, 5).tolist():
        along = on_plane(ground.ahead_m + region.half_length_m * ends, ground.left_m + region.half_width_m * k * across)
        aside = on_plane(ground.ahead_m + region.half_length_m * k * across, ground.left_m + region.half_width_m * ends)
        yield Shape("region", [along, aside], REGION, 1 + (abs(k) == 1.0))


def _edges(edges: Sequence[TerrainEdge], path: PathSurfaces) -> Iterator[Shape]:
    """Yield the edges of the path on the borders of their upper surfaces, each with its distance and rise."""
    for edge in edges:
        upper = path.nearest(edge.distance_m + math.copysign(_BESIDE_M, edge.rise_m))
        if upper is None:
            continue
        y = np.array([PATH_HALF_WIDTH_M, -PATH_HALF_WIDTH_M])
        x = edge.distance_m - math.tan(edge.yaw_rad) * y
        corners = np.column_stack((x, y, np.full(2, upper.at(edge.distance_m))))
        yield Shape("edge", [corners], UP if edge.rise_m > 0.0 else DOWN, 3, label=_edge_text(edge))


def _obstacles(obstacles: Sequence[TerrainObstacle], path: PathSurfaces) -> Iterator[Shape]:
    """Yield each obstacle as a post of its height at its nearest part."""
    for obstacle in obstacles:
        surface = path.nearest(obstacle.distance_m)
        if surface is None:
            continue
        corner = np.array([obstacle.distance_m, obstacle.left_m, surface.at(obstacle.distance_m)])
        beside, up = np.array([0.0, _POST_HALF_M, 0.0]), np.array([0.0, 0.0, obstacle.height_m])
        outline = corner + np.array([-beside, beside, beside + up, -beside + up, -beside])
        yield Shape("obstacle", [outline], OBSTACLE, 3, label=_obstacle_text(obstacle))


def _foothold(foot: NextFoothold) -> Iterator[Shape]:
    """Yield the sole of the next foothold, and around it two deviations of where it will be."""
    if not math.isfinite(foot.ahead_m + foot.left_m + foot.height_m):
        return
    turn = np.linspace(0.0, math.tau, 33)
    a, b = math.tan(foot.slope_sagittal_rad), math.tan(foot.slope_frontal_rad)

    def oval(half_x_m: float, half_y_m: float) -> FloatArray:
        x, y = foot.ahead_m + half_x_m * np.cos(turn), foot.left_m + half_y_m * np.sin(turn)
        return np.column_stack((x, y, a * x + b * y - foot.height_m))

    around = oval(_SOLE_HALF_M[0] + 2.0 * foot.ahead_sd_m, _SOLE_HALF_M[1] + 2.0 * foot.left_sd_m)
    yield Shape("foothold", [around], FOOT, 1)
    yield Shape("foothold", [oval(*_SOLE_HALF_M)], FOOT, 2, filled=True, label=_foot_text(foot))


def _edge_text(edge: TerrainEdge) -> str:
    at = f"at {edge.distance_m:.2f} ±{edge.distance_sd_m:.2f} m"
    if edge.bound_only:
        return f"down ≥ {-100 * edge.rise_m:.0f} cm {at}"
    way = "up" if edge.rise_m > 0.0 else "down"
    return f"{way} {100 * abs(edge.rise_m):.1f} ±{100 * edge.rise_sd_m:.1f} cm {at}"


def _obstacle_text(obstacle: TerrainObstacle) -> str:
    return f"obstacle {100 * obstacle.height_m:.0f} cm high at {obstacle.distance_m:.2f} m"


def _foot_text(foot: NextFoothold) -> str:
    if math.isfinite(foot.time_to_contact_s):
        return f"{foot.side.value} foot in {foot.time_to_contact_s:.2f} ±{foot.time_to_contact_sd_s:.2f} s"
    return f"{foot.side.value} foot"


_BESIDE_M = 0.04
_POST_HALF_M = 0.05
_SOLE_HALF_M = (0.135, 0.05)
