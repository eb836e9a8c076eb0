"""The ground between two frames: the last frame's plane, carried to each IMU sample.

In W the gradient g = (∂z/∂x, ∂z/∂y) of the plane stays. While the camera moves by d, its height above the plane becomes

    h = h₀ + d_z − g · d_xy                                                                                   (1)

and H turns with the camera: the slopes ahead and across are those of g along the axes of H now. d is the velocity of
the IMU, summed up, and the turn of its lever to the camera. The covariance of (g, h₀) goes through (1). What is not
known of d adds to it, for a velocity of covariance V, an acceleration of deviation σ_a and τ since the exposure,

    var h += τ² n V nᵀ + (σ_a τ² / 2)² n nᵀ,   n = (−g, 1)                                                    (2)

and a heading that is off by ψ, of variance τ² σ_w², takes from one slope what it adds to the other. An error of the
vertical is the frame's own: it is in the plane's covariance and does not grow, since no later vertical is used.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from messages import Covariance3, GroundPlane, PropagatedGround, Reason, Status, UnitCalibration, Vec3, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.history import AttitudeAt
from perception.heading import laid_down
from perception.vec3 import ZERO, minus, plus_scaled

OLDEST_PICTURE_NS = 150_000_000
"""From exposure to the sample. A plane is not carried for longer: two frames have been lost."""

ACCELERATION_ERROR_MPS2 = 0.1
"""1 σ of what the samples miss of the acceleration: a shock between two of them, the tilt's share of gravity."""


@dataclass
class _Carried:
    """The plane of one frame in W, and how far the IMU has come since its exposure.

    `covariance` is that of (∂z/∂x, ∂z/∂y, height) at the exposure, `velocity_cov` (m/s)², `turn_var` (rad/s)².
    """

    ground: GroundPlane
    gradient: tuple[float, float]
    covariance: Covariance3
    velocity_cov: Covariance3
    turn_var: float
    lever_W_m: Vec3
    last: AttitudeAt
    travel_W_m: Vec3


class GroundPropagation:
    """Carries the last ground from sample to sample. `R_BC` (3, 3) takes vectors of the left camera to B."""

    def __init__(self, calibration: UnitCalibration, R_BC: FloatArray) -> None:
        self._calibration_id = calibration.id
        self._axis_B = vec3(R_BC[:, 2])
        self._p_BC_m = vec3(calibration.X_BE.p_m)
        self._carried: _Carried | None = None
        self._reason = Reason.STARTING

    def drop(self, reason: Reason) -> None:
        """Carry nothing: there is no ground, for `reason`, which is not NONE."""
        self._reason, self._carried = reason, None

    def begin(
        self, ground: GroundPlane, path: Sequence[AttitudeAt], velocity_cov: Covariance3, turn_var: float
    ) -> None:
        """Carry the valid `ground` from now on.

        `path` leads from the attitude at its exposure to that at the newest sample, where the velocity in W has the
        covariance `velocity_cov`, (m/s)², and the rate about the vertical the variance `turn_var`, (rad/s)².
        """
        start = path[0]
        rows = so3.rows_from_quaternion(start.q_WB)
        heading = self._heading(rows)
        if heading is None:
            return self.drop(Reason.FOOTHOLD_OUT_OF_VIEW)
        c, s = heading
        a, b = math.tan(ground.slope_sagittal_rad), math.tan(ground.slope_frontal_rad)
        per_slope = (1.0 + a * a, 1.0 + b * b)
        self._carried = _Carried(
            ground=ground,
            gradient=(c * a - s * b, s * a + c * b),
            covariance=_turned(_scaled(ground.covariance, per_slope), c, s),
            velocity_cov=velocity_cov,
            turn_var=turn_var,
            lever_W_m=so3.transform(rows, self._p_BC_m),
            last=start,
            travel_W_m=ZERO,
        )
        for attitude in path[1:]:
            _advance(self._carried, attitude)
        return None

    def at(self, now: AttitudeAt) -> PropagatedGround:
        """Return the ground in H at a sample, which is later than all before it."""
        carried = self._carried
        if carried is None:
            return self.no_ground(now.t_ns, self._reason)
        ground, rows = carried.ground, so3.rows_from_quaternion(now.q_WB)
        if now.t_ns - ground.t_exposure_ns > OLDEST_PICTURE_NS:
            return self.no_ground(now.t_ns, Reason.LATE)
        heading = self._heading(rows)
        if heading is None:
            return self.no_ground(now.t_ns, Reason.FOOTHOLD_OUT_OF_VIEW)
        c, s = heading
        _advance(carried, now)
        lever_W = minus(so3.transform(rows, self._p_BC_m), carried.lever_W_m)
        dx, dy, dz = plus_scaled(carried.travel_W_m, lever_W, 1.0)
        gx, gy = carried.gradient
        a, b = c * gx + s * gy, c * gy - s * gx
        elapsed_s = 1e-9 * (now.t_ns - ground.t_exposure_ns)
        covariance = _turned(_moved(carried, dx, dy, elapsed_s), c, -s)
        heading_var = carried.turn_var * elapsed_s**2
        aa, ab, ah, bb, bh, hh = covariance
        covariance = (aa + b * b * heading_var, ab - a * b * heading_var, ah, bb + a * a * heading_var, bh, hh)
        return PropagatedGround(
            t_sample_ns=now.t_ns,
            picture_age_s=elapsed_s,
            status=Status.VALID,
            reason=Reason.NONE,
            slope_sagittal_rad=math.atan(a),
            slope_frontal_rad=math.atan(b),
            height_m=ground.height_m + dz - gx * dx - gy * dy,
            covariance=_scaled(covariance, (1.0 / (1.0 + a * a), 1.0 / (1.0 + b * b))),
            calibration_id=self._calibration_id,
        )

    def no_ground(self, t_ns: int, reason: Reason) -> PropagatedGround:
        """Return the estimate that says only why there is none at `t_ns`."""
        return PropagatedGround.invalid(t_sample_ns=t_ns, reason=reason, calibration_id=self._calibration_id)

    def _heading(self, rows: so3.Rows) -> tuple[float, float] | None:
        """Return cosine and sine of the angle in W of H's x; None if the optical axis is vertical."""
        x, y, _ = so3.transform(rows, self._axis_B)
        return laid_down(x, y)


def _advance(carried: _Carried, now: AttitudeAt) -> None:
    last = carried.last
    half_s = 0.5e-9 * (now.t_ns - last.t_ns)
    carried.travel_W_m = plus_scaled(plus_scaled(carried.travel_W_m, last.v_W_mps, half_s), now.v_W_mps, half_s)
    carried.last = now


def _moved(carried: _Carried, dx: float, dy: float, elapsed_s: float) -> Covariance3:
    """Return the covariance of (∂z/∂x, ∂z/∂y, height) in W after (1), with (2)."""
    xx, xy, xh, yy, yh, hh = carried.covariance
    gx, gy = carried.gradient
    Vxx, Vxy, Vxz, Vyy, Vyz, Vzz = carried.velocity_cov
    along_normal = Vzz - 2.0 * (gx * Vxz + gy * Vyz) + gx * gx * Vxx + 2.0 * gx * gy * Vxy + gy * gy * Vyy
    by_acceleration = (0.5 * ACCELERATION_ERROR_MPS2 * elapsed_s) ** 2 * (1.0 + gx * gx + gy * gy)
    moved_hh = hh - 2.0 * (dx * xh + dy * yh) + dx * dx * xx + 2.0 * dx * dy * xy + dy * dy * yy
    moved_hh += elapsed_s**2 * (along_normal + by_acceleration)
    return xx, xy, xh - dx * xx - dy * xy, yy, yh - dx * xy - dy * yy, moved_hh


def _turned(covariance: Covariance3, c: float, s: float) -> Covariance3:
    """Return a covariance of (gradient, height) along axes against which the old ones are turned by (cos, sin)."""
    aa, ab, ah, bb, bh, hh = covariance
    return (
        c * c * aa - 2.0 * c * s * ab + s * s * bb,
        c * s * (aa - bb) + (c * c - s * s) * ab,
        c * ah - s * bh,
        s * s * aa + 2.0 * c * s * ab + c * c * bb,
        s * ah + c * bh,
        hh,
    )


def _scaled(covariance: Covariance3, by: tuple[float, float]) -> Covariance3:
    """Return the covariance with the first two quantities scaled: gradients to slopes, or back."""
    aa, ab, ah, bb, bh, hh = covariance
    p, q = by
    return p * p * aa, p * q * ab, p * ah, q * q * bb, q * bh, hh
