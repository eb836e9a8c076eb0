"""Samples that repeat."""

import msgspec
import numpy as np

from messages import ImuSample, vec3
from perception.sample_guard import SampleGuard


def sample(seq: int, sf_mps2: float = 9.8) -> ImuSample:
    return ImuSample(
        seq=seq,
        t_sample_ns=seq * 10_000_000,
        t_arrival_ns=seq * 10_000_000,
        sf_B_mps2=(0.0, 0.0, sf_mps2),
        w_WB_B_radps=(0.0, 0.0, 0.0),
        temperature_degC=25.0,
    )


def test_samples_that_repeat_are_refused_until_one_differs() -> None:
    guard = SampleGuard()
    taken = [guard.check(sample(seq)) for seq in range(20)]
    assert taken == [True] * SampleGuard.most_alike + [False] * (20 - SampleGuard.most_alike)
    assert guard.check(sample(20, sf_mps2=9.81))


def test_a_resting_chip_read_faster_than_it_measures_is_accepted() -> None:
    guard, chance = SampleGuard(), np.random.default_rng(2)
    lsb_mps2, lsb_radps = 9.80665 / 4096, np.radians(1 / 32.8)  # of the MPU-6050 at ±8 g and ±1000 °/s
    for seq in range(3000):
        noise_mps2 = np.rint(chance.normal(0.0, 0.02, 3) / lsb_mps2) * lsb_mps2
        noise_radps = np.rint(chance.normal(0.0, np.radians(0.03), 3) / lsb_radps) * lsb_radps
        noisy = msgspec.structs.replace(sample(seq), sf_B_mps2=vec3(noise_mps2), w_WB_B_radps=vec3(noise_radps))
        assert all(guard.check(noisy) for _ in range(2))
