"""Whatever goes missing, clips or is was_reset: the attitude never claims to be right where it is wrong, and recovers.

Wrong is a tilt error beyond both 3° and 4 σ of what is stated.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.evaluation.attitude import tilt_errors_W
from lab.evaluation.hip_motion import Motion, hip_motion, with_mpu6050_noise
from messages import Residual, Status
from perception.attitude.filter import AttitudeFilter, AttitudeSettings

CALIBRATED = Residual(specific_force_mps2=0.0147, scale=0.0005)
LONGEST_RECOVERY_S = 3.5
SECONDS = 24.0

instants_s = st.floats(2.0, SECONDS - 2.0)
outages = st.lists(st.tuples(instants_s, st.sampled_from([0.03, 0.12, 0.16, 0.4, 1.0, 3.0])), max_size=5)
clipped = st.lists(st.tuples(instants_s, st.integers(1, 6)), max_size=3)
seeds = st.integers(0, 7)
walks = st.sampled_from(["standing", "walking", "stops"])
BOUTS_S = {"standing": [], "walking": [(-3.0, 60.0)], "stops": [(3.0, 9.0), (13.0, 19.0)]}


@cache
def walk(name: str, seed: int) -> Motion:
    return with_mpu6050_noise(
        hip_motion(BOUTS_S[name], SECONDS, seed),
        seed,
        sf_bias_mps2=CALIBRATED.specific_force_mps2,
        scale=CALIBRATED.scale,
    )


def without(motion: Motion, gaps: list[tuple[float, float]]) -> Motion:
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    kept = np.ones(len(t_s), dtype=bool)
    for start_s, length_s in gaps:
        kept &= (t_s < start_s) | (t_s >= start_s + length_s)
    return motion.of(kept)


def judge(motion: Motion, clips: list[tuple[float, int]], reset_s: float) -> tuple[int, float]:
    """Return how many VALID attitudes were wrong, and the longest time without a VALID one while samples came."""
    t_s = 1e-9 * (motion.t_ns - motion.t_ns[0])
    flagged = np.zeros(len(t_s), dtype=bool)
    sf_B = motion.sf_B.copy()
    for start_s, count in clips:
        first = int(np.searchsorted(t_s, start_s))
        flagged[first : first + count] = True
        sf_B[first : first + count] *= 0.8
    motion = replace(motion, sf_B=sf_B)
    attitude = AttitudeFilter(AttitudeSettings(), CALIBRATED)
    wrong, waited_s, longest_s, was_reset = 0, 0.0, 0.0, False
    for i, (t_ns, sf, w) in enumerate(
        zip(motion.t_ns.tolist(), motion.sf_B.tolist(), motion.w_B.tolist(), strict=True)
    ):
        if t_s[i] >= reset_s and not was_reset:
            attitude.reset()
            was_reset = True
        attitude.update(t_ns, tuple(sf), tuple(w), bool(flagged[i]))
        step_s = float(t_s[i] - t_s[i - 1]) if i else 0.0
        waited_s = waited_s + step_s if attitude.status is not Status.VALID and step_s < 0.15 else 0.0
        longest_s = max(longest_s, waited_s)
        if attitude.status is Status.VALID:
            error = tilt_errors_W(attitude.R_WB[np.newaxis], motion.R_WB[i : i + 1])[0]
            squares = error @ np.linalg.solve(attitude.rotation_cov_W[:2, :2], error)
            wrong += bool(np.linalg.norm(error) > np.radians(3.0) and squares > 16.0)
    return wrong, longest_s


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(name=walks, seed=seeds, gaps=outages, clips=clipped)
def test_after_any_outages_and_clipping_never_wrong_and_soon_valid(
    name: str, seed: int, gaps: list[tuple[float, float]], clips: list[tuple[float, int]]
) -> None:
    wrong, longest_s = judge(without(walk(name, seed), gaps), clips, reset_s=np.inf)
    assert wrong == 0
    assert longest_s < (LONGEST_RECOVERY_S if name != "walking" else 5.5)  # a start in motion knows no bias


@pytest.mark.long
@settings(max_examples=10, deadline=None)
@given(name=walks, seed=seeds, reset_s=st.floats(3.0, 14.0))
def test_after_a_reset_never_wrong_and_valid_in_time(name: str, seed: int, reset_s: float) -> None:
    wrong, longest_s = judge(walk(name, seed), [], reset_s)
    assert wrong == 0
    assert longest_s < 8.0
