"""Faults of the stream of messages: what they change, when it arrives, and that a trial leaves no trace."""

import numpy as np
import pytest

from lab.faults.message_faults import CAMERA_KINDS, IMU_KINDS, KINDS, OUT_OF_ORDER
from lab.faults.offline import Strike, arrival_ns, in_a_copy, struck
from messages import ImuSample, Tick
from sim_rig.unit import draw_unit

MS = 1_000_000
STEREO = draw_unit(3).stereo


def sample(k: int) -> ImuSample:
    """Return sample `k` of 100 a second, 5 ms old when it arrives."""
    return ImuSample(
        seq=k,
        t_sample_ns=k * 10 * MS,
        t_arrival_ns=k * 10 * MS + 5 * MS,
        sf_B_mps2=(0.1, 0.2, 9.8),
        w_WB_B_radps=(0.3, 0.2, 0.001 * k),
        temperature_degC=25.0,
    )


INPUTS = [message for k in range(200) for message in (sample(k), Tick(t_ns=k * 10 * MS + 6 * MS))]


@pytest.mark.parametrize("name", IMU_KINDS)
def test_a_fault_of_the_imu_strikes_from_its_beginning_to_its_end_and_keeps_the_order_of_arrival(name: str) -> None:
    fault = KINDS[name].draw(np.random.default_rng(4), STEREO)
    after = list(struck(INPUTS, [Strike(fault, 500 * MS, 1500 * MS)]))
    arrivals = [arrival_ns(message) for message in after]
    assert arrivals == sorted(arrivals)
    changed = [m for m in after if isinstance(m, ImuSample) and m not in INPUTS]
    lost = [m for m in INPUTS if m not in after]
    assert changed or lost or len(after) > len(INPUTS)
    assert all(500 * MS <= m.seq * 10 * MS < 1500 * MS for m in changed)
    assert [m for m in after if isinstance(m, Tick)] == [m for m in INPUTS if isinstance(m, Tick)]


@pytest.mark.parametrize("name", ["gyro-step-5", "gyro-drift-5"])
def test_a_bias_is_as_large_as_its_name_says(name: str) -> None:
    fault = KINDS[name].draw(np.random.default_rng(4), STEREO)
    (changed,) = fault(sample(7), 3.0)
    assert isinstance(changed, ImuSample)
    by = np.subtract(changed.w_WB_B_radps, sample(7).w_WB_B_radps)
    assert float(np.degrees(np.linalg.norm(by))) == pytest.approx(5.0)


def test_every_camera_out_of_order_is_a_kind_and_what_nothing_could_show_says_why() -> None:
    assert set(OUT_OF_ORDER) <= set(CAMERA_KINDS)
    assert not any(KINDS[name].undetectable for name in OUT_OF_ORDER)
    assert all(len(kind.undetectable) > 40 for kind in KINDS.values() if kind.undetectable)


def test_a_copy_answers_and_leaves_everything_as_it_is() -> None:
    kept = [1]

    def work() -> list[int]:
        kept.append(2)
        return kept

    assert in_a_copy(work) == [1, 2]
    assert kept == [1]
