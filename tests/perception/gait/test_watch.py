"""Steps out of the hip's own motion, of a hip that is not the rig's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import AnkleState, GaitPhase, Side
from perception.gait.watch import GaitWatch
from tests.bench.walking import FRAME_NS, START_NS, Hip, always

AHEAD_S = 0.25


def errors_s(hip: Hip, from_s: float, until_s: float) -> list[float]:
    """Return how late each contact was predicted a quarter of a second before, or a frame earlier."""
    watch, found = GaitWatch(np.zeros(3)), []
    for t_ns in range(START_NS, START_NS + round(1e9 * until_s), FRAME_NS):
        watch.add_frame(t_ns, hip.attitude, Side.RIGHT)
        for left in (True, False):
            ahead_s = 1e-9 * (hip.next_contact_ns(t_ns, left) - t_ns)
            if t_ns >= START_NS + 1e9 * from_s and AHEAD_S <= ahead_s < AHEAD_S + 1e-9 * FRAME_NS:
                contact = watch.next_contact(left)
                assert contact is not None
                found.append(1e-2 * contact.rows - ahead_s)
    return found


def test_contacts_of_an_even_walk_are_predicted_to_a_frame_and_by_the_right_foot() -> None:
    found = errors_s(Hip(), 4.0, 8.0)
    assert len(found) >= 6
    assert np.abs(found).mean() < 0.015
    assert np.abs(found).max() < 0.05


def test_contacts_are_predicted_while_cadence_and_speed_change() -> None:
    hip = Hip(speed_mps=lambda t: 0.9 + 0.1 * t, step_hz=lambda t: 1.5 + 0.1 * t, seconds=9.0)
    assert np.abs(errors_s(hip, 4.0, 9.0)).mean() < 0.03


def test_a_kerb_which_disturbs_the_bob_does_not_take_the_timing_with_it() -> None:
    found = errors_s(Hip(bump_m=0.15, bump_s=4.1, seconds=8.0), 4.5, 8.0)
    assert np.abs(found).mean() < 0.04


@settings(max_examples=8, deadline=None)
@given(
    step_hz=st.floats(1.3, 2.2),
    speed_mps=st.floats(0.5, 1.6),
    bob_m=st.floats(0.015, 0.03),
    sway_m=st.floats(0.012, 0.03),
)
def test_whoever_walks_evenly_is_predicted(step_hz: float, speed_mps: float, bob_m: float, sway_m: float) -> None:
    hip = Hip(always(speed_mps), always(step_hz), bob_m=bob_m, sway_m=sway_m, seconds=7.0)
    assert np.abs(errors_s(hip, 5.0, 7.0)).mean() < 0.04


def test_who_stands_or_has_stopped_has_no_next_contact() -> None:
    standing, _ = Hip(speed_mps=always(0.0)).watched(4.0)
    assert standing.next_contact(left=True) is None
    hip = Hip(speed_mps=lambda t: 1.1 if t < 3.5 else 0.0, step_hz=lambda t: 1.8 if t < 3.5 else 1e-6)
    walking, _ = hip.watched(4.0)
    assert walking.next_contact(left=True) is not None
    stopped, _ = hip.watched(6.5)
    assert stopped.next_contact(left=True) is None


def test_a_gap_in_the_attitude_begins_anew() -> None:
    hip = Hip()
    watch, t_ns = hip.watched(5.0)
    watch.add_frame(t_ns + 600_000_000, hip.attitude, Side.RIGHT)
    assert watch.next_contact(left=True) is None


@pytest.mark.parametrize("side", list(Side))
def test_the_ankle_says_which_foot_is_its_own(side: Side) -> None:
    """An ankle that lands where the hip says the other foot does: the ankle is right."""
    hip, watch = Hip(), GaitWatch(np.zeros(3))
    of_other = side is Side.RIGHT
    for t_ns in range(START_NS + FRAME_NS, START_NS + 6_000_000_000, FRAME_NS):
        next_ns = hip.next_contact_ns(t_ns, left=of_other)
        for state_ns in range(t_ns - FRAME_NS, t_ns, 10_000_000):
            swings = 1e-9 * (hip.next_contact_ns(state_ns, left=of_other) - state_ns) < 0.35
            phase = GaitPhase.SWING if swings else GaitPhase.STANCE
            load_n = 0.0 if swings else 500.0
            watch.add_ankle(
                AnkleState(t_sample_ns=state_ns, ankle_angle_rad=0.0, ankle_rate_radps=0.0, load_n=load_n, phase=phase)
            )
        watch.add_frame(t_ns, hip.attitude, side)
    contact = watch.next_contact(left=side is Side.LEFT)
    assert contact is not None
    assert 1e-2 * contact.rows == pytest.approx(1e-9 * (next_ns - t_ns), abs=0.04)
