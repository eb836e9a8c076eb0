"""The wearer's gait as the pipeline meets it: attitudes and the ankle's states in, the next landing out."""

import math
from collections.abc import Callable

import msgspec
import numpy as np

from messages import AnkleState, GroundPlane, NextFoothold, Side, Status, StereoCalibration, Terrain, UnitCalibration
from messages.arrays import FloatArray
from perception.attitude.history import AttitudeAt
from perception.gait.landing import Landing, next_landing
from perception.gait.watch import GaitWatch
from perception.heading import heading


class Gait:
    """Predicts landings. `R_BC` (3, 3) takes vectors of the rectified left camera to B; `side` is the prosthesis's."""

    def __init__(self, calibration: UnitCalibration, R_BC: FloatArray, side: Side) -> None:
        self._R_BC = R_BC
        camera = calibration.camera
        # two eyes are worn before the wearer's middle; of a depth camera, its one eye
        self._middle_left_m = 0.5 * camera.X_RL.p_m[0] if isinstance(camera, StereoCalibration) else 0.0
        self._watch = GaitWatch(np.array(calibration.X_BE.p_m))
        self.side = side

    def add_ankle(self, state: AnkleState) -> None:
        """Take what the ankle says of its own foot."""
        self._watch.add_ankle(state)

    def add_frame(self, placed: AttitudeAt, at: Callable[[int], AttitudeAt | None]) -> Landing | None:
        """Come to a frame, exposed when the attitude was `placed`; `at` tells that of other instants.

        Return where the prosthetic foot lands next, in H of that frame; None where no walk is seen.
        """
        self._watch.add_frame(placed.t_ns, at, self.side)
        return self._landing(placed, self.side)

    def with_foothold(self, terrain: Terrain, landing: Landing | None, ground: GroundPlane) -> Terrain:
        """Return `terrain` with the foothold of the same frame, where it is valid."""
        if terrain.status is not Status.VALID:
            return terrain
        return msgspec.structs.replace(terrain, foothold=_foothold(self.side, landing, ground))

    def _landing(self, placed: AttitudeAt, side: Side) -> Landing | None:
        R_WH = heading(placed.R_WB @ self._R_BC)
        if R_WH is None:
            return None
        heading_rad = math.atan2(R_WH[1, 0], R_WH[0, 0])
        return next_landing(self._watch, placed.t_ns, heading_rad, side is Side.LEFT, self._middle_left_m)


def _foothold(
    side: Side, landing: Landing | None, ground: GroundPlane, rise: tuple[float, float] = (math.nan, math.nan)
) -> NextFoothold:
    """Return the foothold of a `landing` on the `ground` of the same frame; `rise`, m, comes with its deviation.

    Without a landing nothing of it is known, without valid ground nothing of that.
    """
    if landing is None:
        return NextFoothold.unknown(side)
    slope_ahead_var, _, _, slope_across_var, _, height_var = ground.covariance
    place = msgspec.structs.replace(
        NextFoothold.unknown(side),
        ahead_m=landing.ahead_m,
        ahead_sd_m=landing.ahead_sd_m,
        left_m=landing.left_m,
        left_sd_m=landing.left_sd_m,
        time_to_contact_s=landing.time_s,
        time_to_contact_sd_s=landing.time_sd_s,
    )
    if ground.status is not Status.VALID:
        return place
    return msgspec.structs.replace(
        place,
        slope_sagittal_rad=ground.slope_sagittal_rad,
        slope_sagittal_sd_rad=math.sqrt(slope_ahead_var),
        slope_frontal_rad=ground.slope_frontal_rad,
        slope_frontal_sd_rad=math.sqrt(slope_across_var),
        height_m=ground.height_m,
        height_sd_m=math.sqrt(height_var),
        rise_m=rise[0],
        rise_sd_m=rise[1],
    )
