"""A depth camera over a floor, on a robot that drives: what each of its pictures says of the ground and its edges."""

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from messages import DepthCalibration, Lens, Residual
from messages.arrays import FloatArray
from messages.errors import UserError
from perception.ground.foothold import FootholdSettings
from perception.ground.meter import GroundMeter
from perception.terrain.edges import Edge, find_edges
from perception.terrain.path_matching import PathSettings, match_path
from perception.terrain.path_points import find_points
from perception.terrain.profile import profile_of
from perception.terrain.surfaces import find_surfaces

_F_PX, _FARTHEST_MM = 400.0, 6000
"""The focal length is not published: 383 to 424 px by another mode of the same camera. What is farther is no depth."""
_DOWN_C = np.array([0.172, 0.927, 0.333])
"""Normal of the plane that most points of the first picture lie on (RANSAC): the mount does not move on the robot."""
_REGION = FootholdSettings(
    ahead_m=0.8, half_length_m=0.25, half_width_m=0.2, nominal_height_m=0.6, height_margin_m=0.15
).region


class FloorSeen(NamedTuple):
    """One picture's floor: height of the camera above it and slopes ahead and to the left, NaN where it is refused, and
    the edges across the path."""

    name: str
    height_m: float
    slopes_rad: tuple[float, float]
    edges: list[Edge]


def floors_seen(folder: Path) -> list[FloorSeen]:
    """Return what the pictures `depth_*.png` (480, 640) of a folder, mm, say of the floor.

    Raises:
        UserError: A picture cannot be read.
    """
    lens = Lens(width_px=640, height_px=480, fx_px=_F_PX, fy_px=_F_PX, cx_px=320.0, cy_px=240.0, distortion=(0.0,) * 4)
    meter, path = GroundMeter(DepthCalibration(lens=lens, baseline_m=0.05), Residual()), PathSettings()
    R_HC, w_C = level_heading(-_DOWN_C / np.linalg.norm(_DOWN_C)), np.zeros(3)
    seen = []
    for place in sorted(folder.glob("depth_*.png")):
        stored = cv2.imread(str(place), cv2.IMREAD_UNCHANGED)
        if stored is None:
            raise UserError(f"{place}: not a picture")
        images = (np.where(stored > _FARTHEST_MM, 0, stored).astype(np.uint16),)
        fit = meter.measure(images, R_HC, w_C, 0.0, _REGION, None).fit
        height_m = _REGION.nominal_height_m if fit is None else fit.plane.height_m
        matched = match_path(meter.camera, images, R_HC, height_m, path)
        points = find_points(meter.camera, images, matched, R_HC, w_C, 0.0, height_m, path, None)
        edges = find_edges(find_surfaces(profile_of(points, 0.0, 2.0 * path.half_width_m)), points, 0.0)
        slopes = (np.nan, np.nan) if fit is None else tuple(np.arctan(fit.plane.gradient).tolist())
        seen.append(FloorSeen(place.stem, np.nan if fit is None else height_m, slopes, edges))
    return seen


def level_heading(up_C: FloatArray) -> FloatArray:
    """Return R_HC (3, 3) of a camera in which the unit vector `up_C` (3,) is upright."""
    ahead_C = np.array([0.0, 0.0, 1.0]) - up_C[2] * up_C
    ahead_C /= np.linalg.norm(ahead_C)
    return np.stack((ahead_C, np.cross(up_C, ahead_C), up_C))
