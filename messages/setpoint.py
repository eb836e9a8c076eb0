"""What an ankle should be over its next stance: what the daemon publishes on the topic `setpoint`."""

import msgspec

from messages.inputs import GaitPhase
from messages.reasons import Reason, Status, status_without_numbers
from messages.terrain import TerrainKind

STANCE_PERCENT = (0, 25, 50, 75, 100)
"""Where over stance, from contact to toe-off, a set-point has its points; between them it runs in straight lines."""

Points = tuple[float, float, float, float, float]
"""One number at each of `STANCE_PERCENT`."""

_UNKNOWN: Points = (float("nan"),) * 5


class Setpoint(msgspec.Struct, frozen=True, kw_only=True):
    """The impedance of the prosthetic ankle over its next stance, for ground seen at `t_exposure_ns`.

    The ankle's moment is stiffness (equilibrium − angle) − damping · rate, dorsiflexion positive; the angle is 0 where
    the shank is upright on level ground under a flat foot. The `_sd` of each point is one standard deviation, that of
    the slope included. `phase` is what the foot does now: in swing the set-point is for the contact that comes next, in
    stance for the one after it. `slope_rad` > 0 is uphill ahead. `table_id` names the table the numbers come from.
    """

    t_exposure_ns: int
    frame_seq: int
    status: Status
    reason: Reason
    phase: GaitPhase
    kind: TerrainKind
    slope_rad: float
    slope_sd_rad: float
    equilibrium_rad: Points
    equilibrium_sd_rad: Points
    stiffness_nm_per_rad: Points
    stiffness_sd_nm_per_rad: Points
    damping_nms_per_rad: Points
    damping_sd_nms_per_rad: Points
    table_id: str
    calibration_id: str

    @classmethod
    def invalid(
        cls,
        *,
        t_exposure_ns: int,
        frame_seq: int,
        reason: Reason,
        phase: GaitPhase,
        table_id: str,
        calibration_id: str,
        kind: TerrainKind = TerrainKind.UNKNOWN,
    ) -> "Setpoint":
        """Return the set-point that says only why there is none: a receiver walks as on level ground.

        Raises ValueError for `Reason.NONE`.
        """
        return cls(
            t_exposure_ns=t_exposure_ns,
            frame_seq=frame_seq,
            status=status_without_numbers(reason),
            reason=reason,
            phase=phase,
            kind=kind,
            slope_rad=_UNKNOWN[0],
            slope_sd_rad=_UNKNOWN[0],
            equilibrium_rad=_UNKNOWN,
            equilibrium_sd_rad=_UNKNOWN,
            stiffness_nm_per_rad=_UNKNOWN,
            stiffness_sd_nm_per_rad=_UNKNOWN,
            damping_nms_per_rad=_UNKNOWN,
            damping_sd_nms_per_rad=_UNKNOWN,
            table_id=table_id,
            calibration_id=calibration_id,
        )

    def without_numbers(self, reason: Reason) -> "Setpoint":
        """Return what is left of the set-point for a `reason` that is not NONE."""
        return Setpoint.invalid(
            t_exposure_ns=self.t_exposure_ns,
            frame_seq=self.frame_seq,
            reason=reason,
            phase=self.phase,
            table_id=self.table_id,
            calibration_id=self.calibration_id,
            kind=self.kind,
        )
