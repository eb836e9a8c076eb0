"""What the ground fit asks of a camera, whether it matches a stereo pair or delivers depth: disparities along rays.

Disparity d = f B / z of a focal length f and a baseline B is inverse depth in the unit in which the noise is even, for
a matched pair and for the stereo pair inside a depth camera alike. (A time-of-flight camera, whose noise is even in z,
is fitted all the same, but its far pixels then count less than they are worth.)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from messages import Image
from messages.arrays import FloatArray
from perception import so3
from perception.depth.eye_shifts import EyeShifts
from perception.depth.repeats import Repeats


class OutOfRangeError(Exception):
    """The ground is nearer than the camera can measure."""


@dataclass(frozen=True)
class DisparityPatch:
    """Part of a picture: for each of (rows, columns) pixels what is seen there.

    `rays_C` (rows, columns, 3) have z = 1; `disparity_px` is NaN where nothing is known; `row_time_s` is when the
    pixel was exposed, relative to mid-exposure of the middle row.
    """

    rays_C: FloatArray
    disparity_px: FloatArray
    row_time_s: NDArray[np.floating]

    def thinned(self, most_pixels: int) -> tuple["DisparityPatch", int]:
        """Return every `stride`-th row and column, about `most_pixels` of them, and the stride."""
        stride = max(1, round(np.sqrt(self.disparity_px.size / most_pixels)))
        return self.every(stride, stride), stride

    def every(self, rows: int, columns: int) -> "DisparityPatch":
        """Return one of so many rows and columns."""
        some = (slice(None, None, rows), slice(None, None, columns))
        return DisparityPatch(self.rays_C[some], self.disparity_px[some], self.row_time_s[some])

    def rays_H(self, R_HC: FloatArray, w_HC_C_radps: FloatArray, rise_rate: float) -> FloatArray:
        """Return the rays (rows, columns, 3) in H, each as long as depth of C at mid-exposure asks.

        A rolling shutter exposes each row at a time τ of its own, while the camera turns by `w_HC_C_radps` and rises
        by the share `rise_rate` of its height a second: R_HC(t + τ) r ≈ R_HC (r + τ ω × r), and h(t + τ) = h + τ ḣ.
        """
        tau_s = self.row_time_s[..., None]
        turned = self.rays_C @ R_HC.T + tau_s * (self.rays_C @ (R_HC @ so3.skew(w_HC_C_radps)).T)
        rays_H: FloatArray = turned / (1.0 + tau_s * rise_rate)
        return rays_H


class View(NamedTuple):
    """Part of what a camera sees: tangents of C's rays x / z and y / z, and depths z, from and to."""

    across: tuple[float, float]
    down: tuple[float, float]
    depth_m: tuple[float, float]


class DisparityCamera(Protocol):
    """Turns the raw images of one frame into disparities, where they are asked for.

    `image_sizes_px` are the (width, height) of the images of a frame; E is the raw camera whose optical centre C
    shares. `scale_residual` is one standard deviation of a relative error common to all depths.
    """

    @property
    def image_sizes_px(self) -> Sequence[tuple[int, int]]:
        """Return the size of each image of a frame."""

    @property
    def f_px(self) -> float:
        """Return the focal length in which disparity is counted."""

    @property
    def baseline_m(self) -> float:
        """Return the baseline in which disparity is counted."""

    @property
    def R_EC(self) -> FloatArray:
        """Return (3, 3): vectors from C to E."""

    @property
    def scale_residual(self) -> float:
        """Return what is uncertain of the scale of depth, relatively."""

    def find_disparities(self, images: Sequence[Image], points_C: FloatArray) -> DisparityPatch | None:
        """Return the smallest patch that shows `points_C` (N, 3), or None if the last of them is not in view.

        All points lie before the camera; the patch is cut at the image's border. Raises OutOfRangeError where the
        points are too near to be measured.
        """

    @property
    def tangents_down(self) -> tuple[float, float]:
        """Return y / z of the rays through the first and the last row."""

    def find_in_view(self, images: Sequence[Image], view: View) -> DisparityPatch | None:
        """Return the patch that shows `view`, or None where none of it is in the picture.

        What is nearer than can be measured is not found.
        """

    def laid_on_plane(self, images: Sequence[Image], patch: DisparityPatch, theta_C: FloatArray) -> DisparityPatch:
        """Return a `patch` of `images` in which what shows the plane d = r · `theta_C` (3,), px, as well as what was
        matched, as where a floor repeats itself, is that plane."""

    def blind_share(self, images: Sequence[Image], points_C: FloatArray) -> float:
        """Return of what part of the picture about `points_C` (N, 3), before the camera, is white or black."""

    def find_repeats(self, images: Sequence[Image], points_C: FloatArray, theta_C: FloatArray) -> Repeats:
        """Return the planes that match as well as d = r · `theta_C` (3,), px, because the ground there repeats itself.

        `points_C` (N, 3), before the camera, are the corners of the region that is asked about.
        """

    def find_shifts(
        self,
        images: Sequence[Image],
        patch: DisparityPatch,
        points_C: FloatArray,
        theta_C: FloatArray,
        w_C_radps: FloatArray,
        v_C_mps: FloatArray,
    ) -> EyeShifts | None:
        """Return how one eye is shifted against the other where a `patch` that was found shows `points_C` (N, 3).

        The plane there is d = r · `theta_C`, px; the camera turns by `w_C_radps` (3,) and moves by `v_C_mps` (3,). None
        without two eyes that see it.
        """
