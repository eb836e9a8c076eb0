"""The speed of a walk is told from the ripple of its steps, and a change of it within a step."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from perception.gait.speed import Gone, WalkingSpeed
from tests.bench.walking import always

_DT_S = 0.02
_THETA_RADPS = 2.0 * math.pi * 0.9


def followed(
    speed_mps: Callable[[float], float], until_s: float, *, limp_mps: float = 0.0, noise_mps: float = 0.0
) -> tuple[WalkingSpeed, float]:
    """Return the filter after a walk with a ripple of 0.15 m/s once a step, and its phase."""
    speed, chance = WalkingSpeed(speed_mps(0.0)), np.random.default_rng(4)
    theta = 0.0
    for t_s in np.arange(0.0, until_s, _DT_S):
        theta = _THETA_RADPS * float(t_s)
        ripple_mps = 0.15 * math.cos(2.0 * theta + 0.3) + limp_mps * math.sin(theta)
        speed.see(_DT_S, theta, speed_mps(float(t_s)) + ripple_mps + noise_mps * float(chance.standard_normal()))
    return speed, theta


def gone(speed_mps: Callable[[float], float], until_s: float, tau_s: float = 0.3, *, limp_mps: float = 0.0) -> Gone:
    speed, theta = followed(speed_mps, until_s, limp_mps=limp_mps)
    return speed.ahead(tau_s, theta, _THETA_RADPS)


@pytest.mark.parametrize("limp_mps", [0.0, 0.1])
@pytest.mark.parametrize("until_s", [3.0, 3.1, 3.25, 3.4])
def test_what_repeats_with_the_stride_is_no_change_of_speed(until_s: float, limp_mps: float) -> None:
    even = gone(always(1.2), until_s, limp_mps=limp_mps)
    assert even.speed_mps == pytest.approx(1.2, abs=0.03)
    ripple_m = 0.15 * math.sin(2.0 * _THETA_RADPS * (until_s - _DT_S) + 0.3) / (2.0 * _THETA_RADPS)
    ripple_m -= limp_mps * math.cos(_THETA_RADPS * (until_s - _DT_S)) / _THETA_RADPS
    assert even.way_m == pytest.approx(1.2 * 0.3 - ripple_m, abs=0.01)


def test_a_change_of_speed_is_followed_within_a_step_and_does_not_go_on_for_ever() -> None:
    def slower(t_s: float) -> float:
        return 1.2 - 0.8 * min(max(t_s - 3.0, 0.0), 0.6)

    now_s = 3.4
    slowing = gone(slower, now_s)
    assert slower(now_s + 0.3) - 0.05 < slowing.speed_mps < slower(now_s) - 0.01
    assert gone(slower, now_s, 2.0).speed_mps > 0.6


def test_an_even_walk_states_less_than_one_that_changes() -> None:
    even = gone(always(1.2), 4.0)
    changing = gone(lambda t_s: 1.2 - 0.5 * max(t_s - 3.6, 0.0), 4.0)
    assert changing.cov[0, 0] > 4.0 * even.cov[0, 0]
    assert math.sqrt(even.cov[0, 0]) < 0.01
    assert math.sqrt(changing.cov[0, 0]) > 0.01


def test_the_covariance_grows_with_the_time_ahead() -> None:
    speed, theta = followed(always(1.2), 3.0, noise_mps=0.03)
    near, far = (speed.ahead(tau_s, theta, _THETA_RADPS).cov for tau_s in (0.1, 0.6))
    assert far[0, 0] > near[0, 0]
    assert far[1, 1] > near[1, 1]
    assert np.linalg.eigvalsh(far).min() > 0.0
