"""The two actuators' commands: torques about Z and X as functions of time."""

from collections.abc import Callable

import numpy as np

from messages.arrays import FloatArray

Excitation = Callable[[FloatArray], FloatArray]
"""From times (n,) in seconds to torques (n, 2) in N·m about I's Z and P's X."""


def random_steps(update_hz: float, span_nm: tuple[float, float], duration_s: float, seed: int) -> Excitation:
    """Return uniformly distributed torques within ± `span_nm`, drawn anew `update_hz` times a second and held.

    They repeat after `duration_s`.
    """
    levels = np.random.default_rng(seed).uniform(-1.0, 1.0, (int(duration_s * update_hz) + 1, 2)) * np.array(span_nm)

    def torque_nm(t_s: FloatArray) -> FloatArray:
        held: FloatArray = levels[np.floor(t_s * update_hz).astype(np.int64) % len(levels)]
        return held

    return torque_nm


def sampled(t_s: FloatArray, torque_nm: FloatArray) -> Excitation:
    """Return torques (n, 2) known at `t_s` (n,), joined by lines."""

    def between(at_s: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(at_s, t_s, column) for column in torque_nm.T])

    return between
