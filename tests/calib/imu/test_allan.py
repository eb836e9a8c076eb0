"""Allan deviations of known noise, and of a real log whose figures were measured elsewhere."""

import numpy as np
import pytest

from calib.imu.allan import axis_noise, noise_of
from calib.imu.log import ImuLog, Units, read_logs
from messages import UserError
from messages.constants import STANDARD_GRAVITY_MPS2
from tests.bench.data_folder import shared_data


def test_white_noise_has_its_density_and_no_random_walk() -> None:
    rng = np.random.default_rng(1)
    found = axis_noise("gyro_x", rng.normal(0.0, 0.02, 60_000), 100.0)
    assert found.density.low < 0.002 < found.density.high  # 0.02 / √100
    assert found.density.value == pytest.approx(0.002, rel=0.05)
    assert found.at(1.0).value == pytest.approx(0.002, rel=0.1)
    assert np.isnan(found.walk.value)
    assert np.isnan(found.at(1e6).value)


def test_a_random_walk_is_told() -> None:
    rng = np.random.default_rng(2)
    walk = np.cumsum(rng.normal(0.0, 1e-3 / 10.0, 60_000))  # 1e-3 per √s at 100 Hz
    found = axis_noise("gyro_x", walk + rng.normal(0.0, 0.002, 60_000), 100.0)
    assert found.walk.value == pytest.approx(1e-3, rel=0.5)


def test_periods_that_do_not_overlap_are_averaged_one_by_one() -> None:
    blocks = np.repeat(np.array((0.0, 2.0, 0.0, 2.0, 0.0, 2.0, 0.0, 2.0, 0.0, 2.0)), 100)
    found = axis_noise("x", np.concatenate((blocks, np.full(50, 9.0))), 100.0)  # half a period more, not counted
    assert found.apart[1.0].value == pytest.approx(np.sqrt(2.0))
    assert found.apart[1.0].low < found.apart[1.0].value < found.apart[1.0].high
    assert np.isnan(found.apart[10.0].value)


@pytest.mark.long
def test_intervals_of_the_deviation_hold_92_to_98_times_in_100() -> None:
    inside, apart = [], []
    for seed in range(1000, 1400):
        found = axis_noise("x", np.random.default_rng(seed).normal(0.0, 1.0, 6_000), 100.0)
        true = 0.1 / np.sqrt(found.tau_s)
        inside.append((found.low <= true) & (true <= found.high))
        apart.append(found.apart[1.0].low <= 0.1 <= found.apart[1.0].high)
    for share in (float(np.mean(inside)), float(np.mean(apart))):
        assert 0.92 <= share <= 0.98, share


def test_what_does_not_rest_is_refused() -> None:
    rng = np.random.default_rng(3)
    n = 3_000
    shaken = ImuLog("shaken", np.arange(n) / 100.0, rng.normal(0.0, 3.0, (n, 3)), np.ones((n, 3)), np.full(n, 30.0))
    with pytest.raises(UserError, match="shaken: the longest rest is 0 s, allowed from 60"):
        noise_of([shaken], "shaken")


def test_an_axis_that_never_changes_is_refused() -> None:
    n = 7_000
    dead = ImuLog("dead", np.arange(n) / 100.0, np.tile((0.0, 0.0, 9.8), (n, 1)), np.zeros((n, 3)), np.full(n, 30.0))
    with pytest.raises(UserError, match="dead: an axis reads the same value all the time"):
        noise_of([dead], "dead")


@pytest.mark.long
def test_a_real_mpu6050_has_the_deviations_that_were_measured() -> None:
    path = shared_data("mpu6050_sunsided") / "unmoved-with-x-pointing-forward-10min.csv.gz"
    axes, rest_s = noise_of(read_logs([path], Units(acc_per_g=4096.0, gyro_per_dps=131.0)), "mpu6050")
    assert rest_s > 600.0
    told = {axis.name: axis for axis in axes}
    for name, at_50_s in (("gyro_x", 0.0027), ("gyro_y", 0.0013), ("gyro_z", 0.0017)):  # measured without overlap
        assert np.degrees(told[name].apart[50.0].value) == pytest.approx(at_50_s, rel=0.1)
    for name, at_1_s, at_10_s in (("gyro_x", 0.0126, 0.0057), ("gyro_y", 0.0092, 0.0030), ("gyro_z", 0.0091, 0.0034)):
        assert np.degrees(told[name].at(1.0).value) == pytest.approx(at_1_s, rel=0.1)
        assert np.degrees(told[name].at(10.0).value) == pytest.approx(at_10_s, rel=0.1)
    for name, at_1_s, at_10_s in (("acc_x", 0.31, 0.10), ("acc_y", 0.31, 0.11), ("acc_z", 0.49, 0.18)):
        by_mg = 1e3 / STANDARD_GRAVITY_MPS2
        assert by_mg * told[name].at(1.0).value == pytest.approx(at_1_s, rel=0.1)
        assert by_mg * told[name].at(10.0).value == pytest.approx(at_10_s, rel=0.1)
