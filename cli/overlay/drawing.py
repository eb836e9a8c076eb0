"""What the service says of one frame, drawn into the picture in which it was seen."""

import math
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from cli.overlay.lettering import WHITE, Colour, Lettering, Picture, bar
from cli.overlay.projection import Sight
from daemon.pictures import grey
from messages import GroundPlane, Image, NextFoothold, Status, Terrain, TerrainEdge, TerrainObstacle
from messages.arrays import BoolArray, FloatArray
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


def drawn(image: Image, said: Said, region: FootholdSettings) -> Picture:
    """Return `image` (height, width) in colours with what was `said` of it, below a bar of text with its numbers.

    `image` may be smaller than the camera's. `region` is that of the ground. Of a depth image near is bright, and black
    what has no depth.
    """
    picture = cv2.cvtColor(grey(image), cv2.COLOR_GRAY2BGR).astype(np.uint8, copy=False)
    pen = _Pen(picture, said)
    if said.sight is not None:
        pen.surfaces()
        pen.region(region)
        pen.edges()
        pen.obstacles()
        pen.foothold()
    pen.write_labels()
    return np.vstack((bar(numbers(said), picture.shape[1]), picture))


class _Pen:
    def __init__(self, picture: Picture, said: Said) -> None:
        self._picture = picture
        self._said = said
        self.letters = Lettering(picture)
        self._labels: list[tuple[str, tuple[float, float], Colour]] = []

    def surfaces(self) -> None:
        """Draw the outline of each surface of the path."""
        path = self._said.surfaces
        for surface in path.surfaces:
            u = np.array([surface.from_m, surface.to_m, surface.to_m, surface.from_m, surface.from_m])
            y = PATH_HALF_WIDTH_M * np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
            self._area(path.points_H(surface, u, y), SURFACE)
            self._line(path.points_H(surface, u, y), SURFACE, 1)

    def region(self, region: FootholdSettings) -> None:
        """Draw the region of the ground, ruled, on the plane that was found in it."""
        ground = self._said.ground
        if ground.status is not Status.VALID:
            return
        a, b = math.tan(ground.slope_sagittal_rad), math.tan(ground.slope_frontal_rad)

        def on_plane(x: FloatArray, y: FloatArray) -> FloatArray:
            return np.column_stack((x, y, a * x + b * y - ground.height_m))

        ends, across = np.array([-1.0, 1.0]), np.ones(2)
        for k in np.linspace(-1.0, 1.0, 5).tolist():
            x, y = ground.ahead_m + region.half_length_m * ends, ground.left_m + region.half_width_m * k * across
            self._line(on_plane(x, y), REGION, 1 + (abs(k) == 1.0))
            x, y = ground.ahead_m + region.half_length_m * k * across, ground.left_m + region.half_width_m * ends
            self._line(on_plane(x, y), REGION, 1 + (abs(k) == 1.0))

    def edges(self) -> None:
        """Draw the edges of the path, each with its distance and rise."""
        for edge in () if self._said.terrain is None else self._said.terrain.edges:
            y = np.array([PATH_HALF_WIDTH_M, -PATH_HALF_WIDTH_M])
            x = edge.distance_m - math.tan(edge.yaw_rad) * y
            colour = UP if edge.rise_m > 0.0 else DOWN
            z = self._height_of(edge)
            if z is None:
                continue
            ends_px = self._line(np.column_stack((x, y, np.full(2, z))), colour, 3)
            if ends_px is not None:
                self._labels.append((_edge_text(edge), ends_px, colour))

    def obstacles(self) -> None:
        """Draw each obstacle as a post of its height at its nearest part."""
        for obstacle in () if self._said.terrain is None else self._said.terrain.obstacles:
            z = self._height_at(obstacle.distance_m)
            if z is None:
                continue
            corner = np.array([obstacle.distance_m, obstacle.left_m, z])
            beside, up = np.array([0.0, _POST_HALF_M, 0.0]), np.array([0.0, 0.0, obstacle.height_m])
            outline = corner + np.array([-beside, beside, beside + up, -beside + up, -beside])
            ends_px = self._line(outline, OBSTACLE, 3)
            if ends_px is not None:
                self._labels.append((_obstacle_text(obstacle), ends_px, OBSTACLE))

    def foothold(self) -> None:
        """Draw the sole of the next foothold with two deviations of where it will be."""
        foot = None if self._said.terrain is None else self._said.terrain.foothold
        if foot is None or not math.isfinite(foot.ahead_m + foot.left_m + foot.height_m):
            return
        turn = np.linspace(0.0, math.tau, 33)
        a, b = math.tan(foot.slope_sagittal_rad), math.tan(foot.slope_frontal_rad)

        def oval(half_x_m: float, half_y_m: float) -> FloatArray:
            x, y = foot.ahead_m + half_x_m * np.cos(turn), foot.left_m + half_y_m * np.sin(turn)
            return np.column_stack((x, y, a * x + b * y - foot.height_m))

        self._line(oval(_SOLE_HALF_M[0] + 2.0 * foot.ahead_sd_m, _SOLE_HALF_M[1] + 2.0 * foot.left_sd_m), FOOT, 1)
        self._area(oval(*_SOLE_HALF_M), FOOT)
        at_px = self._line(oval(*_SOLE_HALF_M), FOOT, 2)
        if at_px is not None:
            self._labels.append((_foot_text(foot), at_px, FOOT))

    def write_labels(self) -> None:
        """Write what the lines mean, the nearest first."""
        for text, at_px, colour in sorted(self._labels, key=lambda label: -label[1][1]):
            self.letters.label(text, at_px, colour)

    def _height_of(self, edge: TerrainEdge) -> float | None:
        """Return z of the border of the upper surface."""
        upper = self._said.surfaces.nearest(edge.distance_m + math.copysign(_BESIDE_M, edge.rise_m))
        return None if upper is None else upper.at(edge.distance_m)

    def _height_at(self, x_m: float) -> float | None:
        surface = self._said.surfaces.nearest(x_m)
        return None if surface is None else surface.at(x_m)

    def _pixels(self, corners_H: FloatArray) -> FloatArray:
        """Return pixels (n, 2) along the lines from corner to corner."""
        assert self._said.sight is not None
        along = [np.linspace(one, other, _PIECES) for one, other in pairwise(corners_H)]
        pixels: FloatArray = self._said.sight.pixels(np.concatenate(along))
        scale: float = self._picture.shape[1] / self._said.sight.lens.width_px
        return scale * (pixels + 0.5) - 0.5

    def _line(self, corners_H: FloatArray, colour: Colour, width: int) -> tuple[float, float] | None:
        """Draw lines through `corners_H` (n, 3); return the rightmost pixel of it in the picture, if any is."""
        pixels = self._pixels(corners_H)
        rows, columns = self._picture.shape[:2]
        shown: BoolArray = ~np.isnan(pixels.sum(axis=1))
        for one, other in pairwise(range(len(pixels))):
            if shown[one] and shown[other]:
                ends = np.rint(pixels[[one, other]] * 2**_SHIFT).astype(int)
                thick = max(1, round(width * self.letters.unit))
                cv2.line(self._picture, tuple(ends[0]), tuple(ends[1]), colour, thick, cv2.LINE_AA, _SHIFT)
        inside = shown & (np.nan_to_num(pixels, nan=-1.0) >= 0.0).all(axis=1)
        inside &= (np.nan_to_num(pixels) <= (columns - 1, rows - 1)).all(axis=1)
        if not inside.any():
            return None
        rightmost = pixels[inside][np.argmax(pixels[inside][:, 0])]
        return float(rightmost[0]), float(rightmost[1])

    def _area(self, corners_H: FloatArray, colour: Colour) -> None:
        pixels = self._pixels(corners_H)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if len(pixels) > _LEAST_CORNERS:
            tinted = self._picture.copy()
            cv2.fillPoly(tinted, [np.rint(pixels).astype(np.int32)], colour)
            self._picture[:] = cv2.addWeighted(self._picture, 1.0 - _TINT, tinted, _TINT, 0.0)


def numbers(said: Said) -> list[tuple[str, Colour]]:
    """Return the lines of text on slope, height and kind, or why there are none, each in its colour."""
    ground, terrain = said.ground, said.terrain
    if ground.status is Status.VALID:
        sd = [math.sqrt(ground.covariance[k]) for k in (0, 3, 5)]
        text = (
            f"ahead {_degrees(ground.slope_sagittal_rad)} ±{math.degrees(sd[0]):.1f}°   "
            f"across {_degrees(ground.slope_frontal_rad)} ±{math.degrees(sd[1]):.1f}°   "
            f"height {100 * ground.height_m:.1f} ±{100 * sd[2]:.1f} cm"
        )
        lines = [(text, REGION)]
    else:
        lines = [(f"no ground: {ground.reason.value}", OBSTACLE)]
    if terrain is None:
        return [*lines, (f"{said.t_s:.2f} s", WHITE)]
    if terrain.status is not Status.VALID:
        return [*lines, (f"{said.t_s:.2f} s   no terrain: {terrain.reason.value}", OBSTACLE)]
    return [*lines, (f"{said.t_s:.2f} s   {terrain.kind.value} {terrain.probability:.0%}", WHITE)]


def _degrees(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):+.1f}°"


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


_PIECES = 24
_SHIFT = 3
_TINT = 0.18
_LEAST_CORNERS = 3
_BESIDE_M = 0.04
_POST_HALF_M = 0.05
_SOLE_HALF_M = (0.135, 0.05)
