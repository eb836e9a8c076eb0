"""The chip's data-ready line through the kernel's GPIO character device, and the driver that waits on it."""

import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from drivers.imu.data_ready import GpiodDataReady
from drivers.protocols import DeviceError
from sim_rig.kernel.chip_server import INTERRUPT_LINE, gpio_chip_path
from tests.kernel.imu_bench import KernelImuBench, kernel_imu

PERIOD_NS = 10_000_000


@pytest.fixture
def bench() -> Iterator[KernelImuBench]:
    with kernel_imu(with_line=True) as opened:
        yield opened


def test_two_hundred_samples_are_two_hundred_edges(bench: KernelImuBench) -> None:
    samples = bench.run(2.2)
    assert len(samples) >= 200
    assert bench.imu.counters.lost == 0
    assert bench.imu.counters.edges_missed <= 0.02 * len(samples)


def test_sample_times_are_those_of_the_edges(bench: KernelImuBench) -> None:
    samples = bench.run(2.0)[50:]
    spacing_ns = np.diff([sample.t_sample_ns for sample in samples])
    assert np.median(spacing_ns) == pytest.approx(PERIOD_NS, rel=0.02)
    assert bench.imu.period_s == pytest.approx(1e-9 * PERIOD_NS, rel=0.02)
    assert all(sample.t_sample_ns < sample.t_arrival_ns for sample in samples)


def test_edges_that_wait_are_all_there_with_the_kernels_stamps(bench: KernelImuBench) -> None:
    bench.run(0.2)
    with pytest.raises(DeviceError, match="busy"):
        GpiodDataReady(gpio_chip_path(), INTERRUPT_LINE)
    bench.imu.close()
    line = GpiodDataReady(gpio_chip_path(), INTERRUPT_LINE)
    before_ns = time.monotonic_ns()
    time.sleep(0.5)
    edges = line.wait(0.0)
    after_ns = time.monotonic_ns()
    assert 45 <= len(edges) <= 53
    assert all(before_ns < edge < after_ns for edge in edges)
    assert all(later > sooner for sooner, later in pairwise(edges))
    assert line.dropped == 0
    line.close()


def test_a_chip_asleep_raises_no_edges(bench: KernelImuBench) -> None:
    bench.imu.close()
    with bench.kernel_chip.server.lock:
        bench.kernel_chip.chip.brown_out()
    line = GpiodDataReady(gpio_chip_path(), INTERRUPT_LINE)
    assert line.wait(0.1) == []
    line.close()


def test_a_full_buffer_loses_the_oldest_and_counts_them(bench: KernelImuBench) -> None:
    bench.imu.close()
    line = GpiodDataReady(gpio_chip_path(), INTERRUPT_LINE)
    assert line.wait(1.0)
    for _ in range(600):
        bench.kernel_chip.server.pulse()
    edges = [*line.wait(0.0), *line.wait(0.05)]
    assert len(edges) >= 500
    assert line.dropped >= 80
    line.close()


def test_a_line_that_is_not_there_is_one_clear_line() -> None:
    with pytest.raises(DeviceError, match="data-ready line 0 of /dev/gpiochip99: No such file") as absent:
        GpiodDataReady("/dev/gpiochip99", 0)
    assert "\n" not in str(absent.value)
    with pytest.raises(DeviceError, match=f"data-ready line 77 of {gpio_chip_path()}"):
        GpiodDataReady(gpio_chip_path(), 77)
