"""Pipeline and prosthesis in one loop, on pictures: what eyes tell before the foot lands, and what darkness does."""

import pytest

from lab.prosthesis.loop import START_NS
from lab.prosthesis.trial import ONE_STEP_S, covered_trial, fitted_unit, new_loop
from sim_rig.prosthesis.bus_faults import BusFaults

pytestmark = pytest.mark.long

FAULTS = BusFaults(loss=0.05, delay_s=0.02)
SEED, SECONDS = 1, 6.0


def test_on_a_new_slope_eyes_leave_less_than_half_of_the_error_that_a_foot_leaves() -> None:
    fitted = fitted_unit(SEED)
    loop = new_loop(fitted, FAULTS)
    loop.run(fitted.wearer.offline_inputs(SECONDS))
    by_foot = fitted.told_by_foot()
    by_foot.advance_to(START_NS + round(1e9 * SECONDS))
    eyes, foot = (
        {step.since_change: step.error_nm_per_kg for step in judged.steps() if step.slope_deg > 1.0}
        for judged in (loop.judged, by_foot)
    )
    assert eyes[1] < 0.5 * foot[1]
    assert not any(step.unsafe for step in loop.judged.steps())
    assert loop.ankle_states > 0.9 * 100 * SECONDS
    assert loop.node.facts().followed >= 2


def test_who_is_covered_on_a_ramp_walks_as_on_level_ground_within_a_step() -> None:
    trial = covered_trial(SEED, FAULTS)
    assert trial.before >= 1
    late = [followed for since_s, followed in trial.after if since_s > ONE_STEP_S]
    assert len(late) >= 2
    assert not any(late)
