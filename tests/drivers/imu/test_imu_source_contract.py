"""What every IMU source keeps to, whatever bus it hangs on. A further bus is one more entry of RIGS."""

from collections.abc import Callable
from itertools import pairwise
from typing import Protocol

import numpy as np
import pytest

from drivers.imu.chips import CHIPS, MPU6050_WHO_AM_I
from drivers.protocols import DeviceError, ImuSource
from messages import ImuSample
from tests.bench.imu_bench import ImuBench, still

RATE_HZ = 100.0


class ImuRig(Protocol):
    """An open IMU at rest and the hands that handle it; time may be simulated or real."""

    @property
    def imu(self) -> ImuSource:
        """Return the source under test."""

    def run(self, duration_s: float) -> list[ImuSample]:
        """Poll for a while."""

    def pause(self, duration_s: float) -> None:
        """Do not poll for a while."""

    def unplug(self) -> None:
        """Make every transfer fail."""

    def plug_in(self) -> None:
        """Undo it."""


class SimulatedRig(ImuBench):
    """The simulated chip as an ImuRig."""

    def unplug(self) -> None:
        """Hold the bus low."""
        self.wires.stick()

    def plug_in(self) -> None:
        """Let it go."""
        self.wires.release()


class EdgeRig(SimulatedRig):
    """The same, read as the daemon reads it: by waiting in the driver."""

    def run(self, duration_s: float, *, poll_s: float = 0.1, jittery: bool = True) -> list[ImuSample]:
        """Wait for each sample for up to `poll_s`."""
        return self.follow(duration_s, poll_s) if jittery else super().run(duration_s, poll_s=poll_s, jittery=False)


def fifo_rig() -> ImuRig:
    """Return a rig whose adapter knows true I2C transfers."""
    rig = SimulatedRig(still)
    rig.imu.open()
    return rig


def edge_rig() -> ImuRig:
    """Return a rig that is read as its data-ready line tells."""
    rig = EdgeRig(still, with_line=True)
    rig.imu.open()
    return rig


def relative(who_am_i: int) -> Callable[[], ImuRig]:
    """Return what makes a rig with a relative of the MPU-6050."""

    def make() -> ImuRig:
        rig = SimulatedRig(still, who_am_i=who_am_i)
        rig.imu.open()
        return rig

    return make


def smbus_rig() -> ImuRig:
    """Return a rig whose adapter knows SMBus transfers only."""
    rig = SimulatedRig(still, smbus_only=True)
    rig.imu.open()
    return rig


RIGS: dict[str, Callable[[], ImuRig]] = {
    "fifo": fifo_rig,
    "smbus": smbus_rig,
    "data_ready": edge_rig,
    **{model.name: relative(model.who_am_i) for model in CHIPS.values() if model.who_am_i != MPU6050_WHO_AM_I},
}


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest) -> ImuRig:
    return RIGS[request.param]()


def test_samples_come_at_the_chips_rate(rig: ImuRig) -> None:
    samples = rig.run(3.0)
    assert len(samples) + rig.imu.counters.lost == pytest.approx(3.0 * RATE_HZ, rel=0.05)
    spacing_s = np.diff([sample.t_sample_ns for sample in samples[100:]]) * 1e-9
    assert np.median(spacing_s) == pytest.approx(1.0 / RATE_HZ, rel=0.04)


def test_times_increase_and_precede_the_arrival(rig: ImuRig) -> None:
    samples = rig.run(3.0)
    assert np.all(np.diff([sample.t_sample_ns for sample in samples]) > 0)
    assert np.all(np.diff([sample.t_arrival_ns for sample in samples]) >= 0)
    assert all(sample.t_sample_ns < sample.t_arrival_ns for sample in samples)


def test_every_sample_is_delivered_or_counted(rig: ImuRig) -> None:
    samples = rig.run(1.0)
    for pause_s in (0.03, 0.5, 1.5):
        rig.pause(pause_s)
        samples += rig.run(0.5)
    assert sum(sample.lost_before for sample in samples) == rig.imu.counters.lost
    assert samples[0].lost_before == 0
    for previous, sample in pairwise(samples):
        assert sample.seq - previous.seq == 1 + sample.lost_before
    assert samples[-1].seq - samples[0].seq == pytest.approx(
        (samples[-1].t_sample_ns - samples[0].t_sample_ns) * 1e-9 * RATE_HZ, rel=0.04
    )


def test_an_imu_at_rest_measures_gravity_and_nothing_else(rig: ImuRig) -> None:
    samples = rig.run(1.0)
    for sample in samples:
        assert np.linalg.norm(sample.sf_B_mps2) == pytest.approx(9.8, rel=0.05)
        assert np.linalg.norm(sample.w_WB_B_radps) < np.deg2rad(25.0)
        assert -20.0 < sample.temperature_degC < 70.0
        assert not sample.clipped


def test_reading_twice_at_once_gives_nothing_twice(rig: ImuRig) -> None:
    samples = rig.run(0.5)
    again = [*rig.imu.read(timeout_s=0.0), *rig.imu.read(timeout_s=0.0), *rig.imu.read(timeout_s=0.0)]
    seen = [sample.seq for sample in [*samples, *again]]
    assert seen == sorted(set(seen))
    passed_s = 1e-9 * (again[-1].t_arrival_ns - samples[-1].t_sample_ns) if again else 0.0
    assert len(again) <= 1.05 * RATE_HZ * passed_s  # on a slow machine time passes between two readings


def test_a_device_that_is_gone_is_an_error_until_it_is_back(rig: ImuRig) -> None:
    before = rig.run(1.0)
    rig.unplug()
    for _ in range(2):
        with pytest.raises(DeviceError) as gone:
            rig.imu.read(timeout_s=0.0)
        assert "\n" not in str(gone.value)
    assert rig.imu.counters.bus_errors > 0
    rig.pause(3.5)  # longer than any of the chips' FIFOs
    rig.plug_in()
    after = rig.run(2.0)
    assert len(after) > 100
    assert after[0].lost_before >= 90
    assert after[0].t_sample_ns > before[-1].t_sample_ns
    assert rig.imu.counters.resets <= 1


def test_close_may_come_at_any_time(rig: ImuRig) -> None:
    rig.imu.close()
    rig.imu.close()
