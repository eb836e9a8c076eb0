"""A vehicle or a lift that carries the ground: how its floor accelerates and turns, whatever the wearer does on it.

Axes of the floor are those of the walk's W: x ahead in the vehicle, y to the left, z up. The wearer's motion is given
over the floor at r; what the IMU measures is that of a frame that accelerates by a and turns at w about the vertical:

    acceleration = a + r̈ + ẇ × r + w × (w × r) + 2 w × ṙ                                 (1)
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from messages.arrays import FloatArray
from sim_rig.walk.ramps import Change, ramped, with_derivatives

_BLEND_S = 0.7


@dataclass(frozen=True)
class Push:
    """After `wait_s` as it was, the vehicle accelerates ahead and upwards and turns to the left for `duration_s`.

    Each comes and goes within `_BLEND_S`, so that velocity and heading change by rate times duration.
    """

    wait_s: float
    duration_s: float
    ahead_mps2: float = 0.0
    up_mps2: float = 0.0
    turn_radps: float = 0.0


@dataclass(frozen=True)
class Ride:
    """Pushes one after another, then `rest_s` as it is; repeated without end, so it must end at rest."""

    pushes: tuple[Push, ...]
    rest_s: float


@dataclass(frozen=True)
class Floor:
    """The floor at n instants in its own axes, (n, 3) each: velocity, acceleration, turn rate and its derivative."""

    v_mps: FloatArray
    a_mps2: FloatArray
    w_radps: FloatArray
    dw_radps2: FloatArray

    def acceleration_mps2(self, r_m: FloatArray, dr_mps: FloatArray, ddr_mps2: FloatArray) -> FloatArray:
        """Return the acceleration (n, 3) of what moves over the floor in this way (n, 3), Eq. (1)."""
        w = self.w_radps
        turning = np.cross(self.dw_radps2, r_m) + np.cross(w, np.cross(w, r_m)) + 2.0 * np.cross(w, dr_mps)
        added: FloatArray = self.a_mps2 + ddr_mps2 + turning
        return added


class Riding:
    """The floor's motion on `ride`; before the start it is at rest. Raises ValueError if the ride does not end so."""

    def __init__(self, ride: Ride) -> None:
        starts_s = np.cumsum([0.0, *(push.wait_s + push.duration_s + _BLEND_S for push in ride.pushes)])
        self._period_s = float(starts_s[-1]) + ride.rest_s
        begins = [(float(start_s) + push.wait_s, push) for start_s, push in zip(starts_s, ride.pushes, strict=False)]
        ahead = self._pulses([(t_s, push, push.ahead_mps2) for t_s, push in begins])
        upwards = self._pulses([(t_s, push, push.up_mps2) for t_s, push in begins])
        turning = self._pulses([(t_s, push, push.turn_radps) for t_s, push in begins])
        self._ahead = (ahead.antiderivative(), ahead)
        self._upwards = (upwards.antiderivative(), upwards)
        self._turn_rate = with_derivatives(turning)[:2]
        for what, speed in (("ahead", self._ahead[0]), ("upwards", self._upwards[0])):
            if abs(float(speed(self._period_s))) > _AT_REST_MPS:
                raise ValueError(f"the ride ends at {float(speed(self._period_s)):+.2f} m/s {what}, must end at rest")

    def at(self, t_s: FloatArray) -> Floor:
        """Return the floor's motion at the instants `t_s` (n,) since the start."""
        t = np.mod(np.maximum(t_s, 0.0), self._period_s)
        none = np.zeros_like(t)
        (speed, ahead), (climb, up) = ((v(t), a(t)) for v, a in (self._ahead, self._upwards))
        turn_rate, dturn_rate = (rate(t) for rate in self._turn_rate)
        return Floor(
            v_mps=np.stack((speed, none, climb), axis=1),
            a_mps2=np.stack((ahead, speed * turn_rate, up), axis=1),
            w_radps=np.stack((none, none, turn_rate), axis=1),
            dw_radps2=np.stack((none, none, dturn_rate), axis=1),
        )

    def _pulses(self, values: list[tuple[float, Push, float]]) -> PPoly:
        changes = [
            change
            for t_s, push, value in values
            if value
            for change in (Change(t_s, _BLEND_S, value), Change(t_s + push.duration_s, _BLEND_S, -value))
        ]
        return ramped(changes, self._period_s)


_AT_REST_MPS = 1e-6
