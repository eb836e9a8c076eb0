"""Where a foot lands: half a step ahead of the hip and beside it, on the way that is walked."""

import math

import numpy as np
import pytest

from messages import Side
from perception.gait.landing import Landing, next_landing, off_edges
from perception.gait.stance import GroundHeight, StanceGround
from perception.terrain.edges import Edge
from perception.terrain.path_ahead import PathAhead
from tests.bench.walking import START_NS, Hip, always


def landing_of(**changed: float) -> Landing:
    values = {"ahead_m": 0.6, "ahead_sd_m": 0.04, "left_m": 0.0, "left_sd_m": 0.03, "time_s": 0.3, "time_sd_s": 0.03}
    return Landing(**(values | {"step_m": 0.65} | changed))


def edge(distance_m: float, rise_m: float, *, yaw_rad: float = 0.0, bound_only: bool = False) -> Edge:
    return Edge(distance_m, 0.005, rise_m, 0.003, yaw_rad, 0.01, bound_only)


@pytest.mark.parametrize(
    ("hip", "most_m"),
    [
        (Hip(), 0.03),
        (Hip(turn_radps=0.5), 0.06),
        (Hip(speed_mps=lambda t: 0.8 + 0.12 * t, step_hz=lambda t: 1.6 + 0.05 * t), 0.04),
        (Hip(speed_mps=always(0.6), step_hz=always(1.35), sway_m=0.03), 0.03),
    ],
)
@pytest.mark.parametrize("left", [True, False])
def test_a_landing_is_predicted_from_the_way_walked(hip: Hip, most_m: float, left: bool) -> None:
    off = []
    for until_s in np.arange(5.0, 7.0, 0.25):
        watch, t_ns = hip.watched(float(until_s))
        contact_ns = hip.next_contact_ns(t_ns, left)
        if not 0.05 < 1e-9 * (contact_ns - t_ns) < 0.4:
            continue
        found = next_landing(watch, t_ns, hip.heading_rad(t_ns), left, 0.0)
        assert found is not None
        off.append(np.array([found.ahead_m, found.left_m]) - hip.foot_m(t_ns, contact_ns))
        assert found.ahead_sd_m > 0.02
        assert found.time_s == pytest.approx(1e-9 * (contact_ns - t_ns), abs=0.06)
    assert np.abs(np.mean(off, axis=0)).max() < most_m


def off_while(hip: Hip, from_s: float, to_s: float) -> list[float]:
    """Return how far ahead of where they land feet are predicted, 0.2 to 0.3 s before, between two times."""
    off_m = []
    for until_s in np.arange(from_s, to_s, 0.05):
        watch, t_ns = hip.watched(float(until_s))
        for left in (True, False):
            contact_ns = hip.next_contact_ns(t_ns, left)
            found = next_landing(watch, t_ns, hip.heading_rad(t_ns), left, 0.0)
            if found is not None and 0.2 < 1e-9 * (contact_ns - t_ns) < 0.3:
                off_m.append(found.ahead_m - float(hip.foot_m(t_ns, contact_ns)[0]))
    return off_m


def test_who_slows_down_within_a_second_takes_shorter_steps_at_once() -> None:
    def speed_mps(t: float) -> float:
        return 1.3 - 0.7 * min(max(t - 4.0, 0.0), 1.0)

    hip = Hip(speed_mps=speed_mps, step_hz=lambda t: 1.6 * math.sqrt(speed_mps(t) / 1.3))
    off_m = off_while(hip, 5.0, 6.4)
    assert len(off_m) >= 4
    assert np.abs(off_m).mean() < 0.065


def test_a_step_is_as_long_as_the_root_of_the_speed_has_it() -> None:
    def speed_mps(t: float) -> float:
        return 1.0 + 0.5 * min(max(t - 4.0, 0.0), 1.0)

    hip = Hip(speed_mps=speed_mps, step_hz=lambda t: 1.7 * math.sqrt(speed_mps(t)))
    watch, t_ns = hip.watched(5.85)
    found = next_landing(watch, t_ns, 0.0, True, 0.0)
    assert found is not None
    assert found.step_m == pytest.approx(math.sqrt(1.45) / 1.7, abs=0.03)


def test_the_middle_of_the_wearer_moves_a_landing_aside() -> None:
    watch, t_ns = Hip().watched(6.0)
    one, other = (next_landing(watch, t_ns, 0.0, True, middle_m) for middle_m in (0.0, -0.06))
    assert one is not None
    assert other is not None
    assert other.left_m - one.left_m == pytest.approx(-0.06)


def test_who_stands_has_no_landing() -> None:
    watch, t_ns = Hip(speed_mps=always(0.0)).watched(4.0)
    assert next_landing(watch, t_ns, 0.0, True, 0.0) is None


def test_feet_are_not_put_across_edges() -> None:
    path = PathAhead(edges=(edge(0.55, 0.17), edge(0.83, 0.17)))
    assert off_edges(landing_of(ahead_m=0.58), path).ahead_m == pytest.approx(0.65)
    assert off_edges(landing_of(ahead_m=0.80), path).ahead_m == pytest.approx(0.73)
    assert off_edges(landing_of(ahead_m=0.50), path).ahead_m == pytest.approx(0.45)
    narrow = PathAhead(edges=(edge(0.55, 0.17), edge(0.70, 0.17)))
    assert off_edges(landing_of(ahead_m=0.56), narrow).ahead_m == pytest.approx(0.625)
    assert off_edges(landing_of(), PathAhead()) == landing_of()


def test_the_ground_under_a_foot_is_what_was_ahead_where_it_landed() -> None:
    stance = StanceGround()
    stance.add(Side.LEFT, landing_of(time_s=0.1), GroundHeight(0.17, 0.004))
    assert math.isnan(stance.rise_to(GroundHeight(0.34, 0.003))[0])
    stance.add(Side.LEFT, landing_of(time_s=0.02), None)  # the picture reaches down to it no more
    stance.add(Side.LEFT, landing_of(time_s=1.1), GroundHeight(0.5, 0.004))
    rise_m, sd_m = stance.rise_to(GroundHeight(0.34, 0.003))
    assert rise_m == pytest.approx(0.17)
    assert 0.005 <= sd_m < 0.01
    stance.add(Side.RIGHT, None, None)
    assert math.isnan(stance.rise_to(GroundHeight(0.34, 0.003))[0])


def test_frames_are_counted_from_the_start() -> None:
    assert Hip().watched(1.0)[1] == START_NS + 950_000_000
