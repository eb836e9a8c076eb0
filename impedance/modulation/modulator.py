"""From the ground that is seen to the impedance of the ankle's next stance: `Modulator`, the sender's side.

A set-point is told only for ground that is seen well enough, of a kind and a slope that the table holds, while the
ankle's own phase agrees with the contact that the eyes foretell. In any other case the message says why and has no
numbers: the ankle walks as on level ground (`impedance.modulation.follower`).
"""

import math
from typing import Final

import numpy as np

from impedance.modulation.curve import Limits, StanceCurve
from impedance.modulation.table import SetpointTable
from messages.arrays import FloatArray
from messages.estimates import GroundPlane
from messages.inputs import AnkleState, GaitPhase
from messages.reasons import Reason, Status
from messages.setpoint import Points, Setpoint
from messages.terrain import NextFoothold, TerrainKind

MOST_SLOPE_SD_RAD: Final = math.radians(5.0)
"""A slope less certain than this is not acted upon. Beside a change of the slope half of that change is in it."""

USUAL_SLOPE_RAD: Final = math.radians(6.0)
"""How steep the ways are that people walk, one standard deviation about level ground: assumed."""

STANDS_IN_NS: Final = 100_000_000
"""Where the ground is not seen in a frame, or the phases disagree, what a picture no older told still stands: it is
sent again with that picture's age, which receivers judge."""

PASSING: Final = frozenset(
    {
        Reason.LOW_TEXTURE,
        Reason.NOT_PLANAR,
        Reason.FOOTHOLD_OUT_OF_VIEW,
        Reason.OUT_OF_RANGE,
        Reason.OCCLUDED,
        Reason.OVER_EXPOSED,
        Reason.UNCERTAIN,
        Reason.NO_NEXT_STEP,
        Reason.PHASE_CONTRADICTS,
    }
)
"""What may pass with the next frame and says nothing against the frames before."""

_SLOPED = (TerrainKind.LEVEL, TerrainKind.RAMP_UP, TerrainKind.RAMP_DOWN)
_SHORTEST_SWING_S, _LONGEST_SWING_S = 0.2, 0.9
_SAME_CONTACT_S = 0.12
_ANKLE_LASTS_NS = 200_000_000


class Modulator:
    """Makes set-points for a body of `mass_kg`, as `table` has them, kept within limits about those of level ground.

    Each number moves from one update to the next no faster than the limits allow, beginning at level ground.
    """

    def __init__(self, table: SetpointTable, mass_kg: float) -> None:
        self._table = table
        self._mass_kg = mass_kg
        self._limits = Limits(table.level(mass_kg))
        self._curve, self._curve_ns = self._limits.level, 0
        self._last: Setpoint | None = None
        self._phase, self._changed_ns, self._ankle_ns = GaitPhase.UNKNOWN, 0, 0

    @property
    def table_id(self) -> str:
        """Return the id of the table in use."""
        return self._table.id

    def add_ankle(self, state: AnkleState) -> None:
        """Take what the ankle says of its own foot."""
        if state.phase is not self._phase:
            self._phase, self._changed_ns = state.phase, state.t_sample_ns
        self._ankle_ns = state.t_sample_ns

    def setpoint(self, ground: GroundPlane, foothold: NextFoothold, kind: TerrainKind) -> Setpoint:
        """Return the set-point for the `foothold` on the `ground` of one frame; `kind` is that of the path ahead."""
        phase = self._phase_at(ground.t_exposure_ns)
        reason = self._refusal(ground, foothold, kind, phase)
        if reason is Reason.NONE:
            self._last = self._told(ground, foothold, kind, phase)
            return self._last
        if self._stands_in(reason, ground.t_exposure_ns) and self._last is not None:
            return self._last
        self._last = None
        return Setpoint.invalid(
            t_exposure_ns=ground.t_exposure_ns,
            frame_seq=ground.frame_seq,
            reason=reason,
            phase=phase,
            table_id=self._table.id,
            calibration_id=ground.calibration_id,
            kind=kind,
        )

    def _stands_in(self, reason: Reason, t_ns: int) -> bool:
        return reason in PASSING and self._last is not None and 0 <= t_ns - self._last.t_exposure_ns <= STANDS_IN_NS

    def _phase_at(self, t_ns: int) -> GaitPhase:
        """Return the phase that the ankle tells, as long as it does."""
        return self._phase if abs(t_ns - self._ankle_ns) <= _ANKLE_LASTS_NS else GaitPhase.UNKNOWN

    def _refusal(self, ground: GroundPlane, foothold: NextFoothold, kind: TerrainKind, phase: GaitPhase) -> Reason:
        """Return why there is no set-point, or NONE."""
        if ground.status is not Status.VALID:
            return ground.reason
        if not math.isfinite(foothold.time_to_contact_s):
            return Reason.NO_NEXT_STEP
        if not math.isfinite(foothold.slope_sagittal_rad):
            return Reason.FOOTHOLD_OUT_OF_VIEW
        if kind not in _SLOPED or not self._table.holds(foothold.slope_sagittal_rad):
            return Reason.NO_SET_POINT
        if not 0.0 <= foothold.slope_sagittal_sd_rad <= MOST_SLOPE_SD_RAD:
            return Reason.UNCERTAIN
        if self._phase_contradicts(ground.t_exposure_ns, foothold, phase):
            return Reason.PHASE_CONTRADICTS
        return Reason.NONE

    def _phase_contradicts(self, t_ns: int, foothold: NextFoothold, phase: GaitPhase) -> bool:
        """Return whether the foot cannot land when the eyes foretell it: it has swung too long by then, or stands and
        has yet to swing."""
        to_contact_s, spread_s = foothold.time_to_contact_s, 2.0 * foothold.time_to_contact_sd_s
        since_change_s = 1e-9 * (t_ns - self._changed_ns) + to_contact_s
        if phase is GaitPhase.SWING:
            return since_change_s - spread_s > _LONGEST_SWING_S
        has_landed = abs(since_change_s) <= _SAME_CONTACT_S + spread_s
        return phase is GaitPhase.STANCE and not has_landed and to_contact_s + spread_s < _SHORTEST_SWING_S

    def _told(self, ground: GroundPlane, foothold: NextFoothold, kind: TerrainKind, phase: GaitPhase) -> Setpoint:
        slope_rad = weighed(foothold.slope_sagittal_rad, foothold.slope_sagittal_sd_rad)
        wanted, deviations = self._table.at(slope_rad, foothold.slope_sagittal_sd_rad, self._mass_kg)
        curve = self._approached(self._limits.bounded(wanted.points), ground.t_exposure_ns)
        return Setpoint(
            t_exposure_ns=ground.t_exposure_ns,
            frame_seq=ground.frame_seq,
            status=Status.VALID,
            reason=Reason.NONE,
            phase=phase,
            kind=kind,
            slope_rad=foothold.slope_sagittal_rad,
            slope_sd_rad=foothold.slope_sagittal_sd_rad,
            equilibrium_rad=_five(curve.points[:, 0]),
            equilibrium_sd_rad=_five(deviations[:, 0]),
            stiffness_nm_per_rad=_five(curve.points[:, 1]),
            stiffness_sd_nm_per_rad=_five(deviations[:, 1]),
            damping_nms_per_rad=_five(curve.points[:, 2]),
            damping_sd_nms_per_rad=_five(deviations[:, 2]),
            table_id=self._table.id,
            calibration_id=ground.calibration_id,
        )

    def _approached(self, wanted: StanceCurve, t_ns: int) -> StanceCurve:
        """Return how far the way to `wanted` has come by `t_ns`; after a silence it begins at level ground."""
        goes_on = self._last is not None and 0 < t_ns - self._curve_ns <= _GOES_ON_NS
        begun = self._curve if goes_on else self._limits.level
        seconds = 1e-9 * (t_ns - self._curve_ns) if goes_on else _FIRST_S
        self._curve, self._curve_ns = self._limits.approached(begun, wanted, seconds), t_ns
        return self._curve


def weighed(slope_rad: float, sd_rad: float) -> float:
    """Return the slope to act on: the mean of what was measured and of what is usual, each by its certainty."""
    return slope_rad * USUAL_SLOPE_RAD**2 / (USUAL_SLOPE_RAD**2 + sd_rad**2)


def _five(numbers: FloatArray) -> Points:
    a, b, c, d, e = np.asarray(numbers, dtype=np.float64).tolist()
    return a, b, c, d, e


_GOES_ON_NS = 250_000_000
_FIRST_S = 0.05
"""The first set-point is as far from level ground as one cycle of frames allows."""
