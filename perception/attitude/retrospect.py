"""The attitudes of the second before the filter's start, once it has started."""

from collections import deque

import numpy as np

from messages import Quaternion, Vec3, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.history import AttitudeAt


class Retrospect:
    """Keeps the rates before a start, in one piece: no two samples farther apart than `longest_step_ns`."""

    def __init__(self, longest_step_ns: int) -> None:
        self._longest_step_ns = longest_step_ns
        self._rates: deque[tuple[int, Vec3]] = deque(maxlen=_MOST_SAMPLES)

    def clear(self) -> None:
        """Forget all rates."""
        self._rates.clear()

    def add(self, t_ns: int, w_B_radps: Vec3) -> None:
        """Take the rate of a sample before the start."""
        if self._rates and t_ns - self._rates[-1][0] > self._longest_step_ns:
            self._rates.clear()
        self._rates.append((t_ns, w_B_radps))

    def take(self, t_ns: int, q_WB: Quaternion, gyro_bias: Vec3, rotation_cov_W: FloatArray) -> list[AttitudeAt]:
        """Return the attitudes before that at `t_ns`, the start, in their order, and forget their rates.

        They are integrated backwards, R(t − dt) = R(t) exp(−w dt), and all have the covariance of the start.
        """
        past: list[AttitudeAt] = []
        for t_before_ns, measured in reversed(self._rates):
            w_B = vec3(np.subtract(measured, gyro_bias))
            dt_s = (t_ns - t_before_ns) * 1e-9
            q_WB = so3.positive(so3.multiply(q_WB, so3.quaternion_from_rotvec(vec3(np.multiply(w_B, -dt_s)))))
            past.append(AttitudeAt(t_before_ns, q_WB, w_B, 0.0, rotation_cov_W))
            t_ns = t_before_ns
        self._rates.clear()
        return past[::-1]


_MOST_SAMPLES = 1024
