"""Whether the view of the ground is sound, frame by frame, and what a view that may be deformed leaves uncertain."""

import math

import numpy as np

from messages import Image
from messages.arrays import FloatArray
from perception.depth.deformation import SOUND, Deformation, DeformationWatch
from perception.depth.eye_shifts import EyeShifts
from perception.ground.meter import GroundMeasurement, GroundMeter
from perception.ground.plane import Plane
from perception.ground.region import FootholdRegion


class ViewCheck:
    """Asks the meter's camera how its eyes are shifted on each plane found; one without two eyes is always sound."""

    longest_step_s = 0.2  # a way between two frames that are asked, at the newest velocity
    least_alike_share = 0.9
    """Of the tiles that matched: in a picture that is turned or late, one row's joints match what lies beside them."""

    def __init__(self, meter: GroundMeter) -> None:
        self._meter = meter
        self._watch = DeformationWatch(meter.rows_px)
        self._t_ns = 0
        self._asked = False
        self._shifts: EyeShifts | None = None
        self.found = SOUND
        """What the frames asked until now have told of the view."""
        self.eyes_are_alike = True
        """Whether the newest frame asked shows both eyes the same where it matched."""

    def check(
        self,
        t_ns: int,
        images: tuple[Image, ...],
        R_HC: FloatArray,
        region: FootholdRegion,
        measured: GroundMeasurement,
        w_C_radps: FloatArray,
        v_C_mps: FloatArray,
        *,
        settled: bool,
    ) -> Deformation:
        """Return what is known of the view with a frame in which a plane was `measured` in `region`.

        Of two frames one is asked; each, as long as it is not `settled` which plane is the ground, or the view
        contradicts.

        The camera turns by `w_C_radps` (3,) and moves by `v_C_mps` (3,) over the ground.
        """
        self._asked = not (settled and self._asked) or self.found.contradicts
        if not self._asked:
            return self.found
        step_s, self._t_ns = 1e-9 * (t_ns - self._t_ns), t_ns
        self._shifts = self._meter.find_shifts(images, R_HC, region, measured, w_C_radps, v_C_mps)
        if self._shifts is None:
            return self.found
        self.eyes_are_alike = not self._shifts.alike_share < self.least_alike_share
        speed_mps = math.hypot(*(R_HC @ v_C_mps)[:2].tolist())
        self.found = self._watch.add(self._shifts, speed_mps * min(step_s, self.longest_step_s))
        return self.found

    def begin_anew(self) -> None:
        """Judge the view by this frame and those to come: the plane is another one at once."""
        self._watch.begin_anew(with_newest=self._asked)
        self.eyes_are_alike = True

    def covariance(self, plane: Plane, R_HC: FloatArray) -> FloatArray:
        """Return the covariance (3, 3) of (a, b, h) by a deformation along the rows as large as what was found.

        It may grow from one side of the tiles to the other, or from above to below, or be common to all of them.
        """
        if self._shifts is None:
            return np.zeros((3, 3))
        (x, y), (half_x, half_y) = self._shifts.middle, self._shifts.half
        across, ahead = np.array([1.0, 0.0, -x]) / half_x, np.array([0.0, 1.0, -y]) / half_y
        ramps = math.sqrt(3.0) * np.array([across, ahead])  # of the same mean square as what is common
        return self._meter.offset_cov(plane, R_HC, self.found.size_px * np.vstack((ramps, [0.0, 0.0, 1.0])))
