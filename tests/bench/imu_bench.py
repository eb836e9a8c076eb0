"""An MPU-6050 driver on a simulated chip in simulated time, with the truth at hand."""

from dataclasses import dataclass, field

import numpy as np

from drivers.imu.chips import MPU6050_WHO_AM_I
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from messages import ImuSample
from messages.arrays import FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.imu.chip_unit import SF_NOISE_DENSITY, W_NOISE_DENSITY, ChipUnit
from sim_rig.imu.data_ready import SimulatedDataReady
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.imu.mpu6050_signal import Motion

ADDRESS = 0x68
NOISY = ChipUnit(sf_noise_density=SF_NOISE_DENSITY, w_noise_density=W_NOISE_DENSITY)


class SimulatedTime:
    """A clock that stands still until someone sleeps."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000_000

    def __call__(self) -> int:
        return self.now_ns

    def sleep(self, duration_s: float) -> None:
        self.now_ns += round(duration_s * 1e9)


def still(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """At rest, z up."""
    return np.tile([0.0, 0.0, STANDARD_GRAVITY_MPS2], (t_ns.size, 1)), np.zeros((t_ns.size, 3))


def swaying(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """About as lively as a walking hip, in every axis, at 0.7 to 1.3 Hz: never twice the same within a minute."""
    t = t_ns[:, None] * 1e-9
    phase = 2.0 * np.pi * np.array([0.7, 1.0, 1.3]) * t
    return np.array([0.0, 0.0, STANDARD_GRAVITY_MPS2]) + 3.0 * np.sin(phase), 2.0 * np.cos(phase)


@dataclass
class ImuBench:
    """Everything from the motion to the samples. `edges_ns` are the true instants of all the chip's samples.

    With the data-ready line the driver waits for edges; without it `run` polls.
    """

    motion: Motion = swaying
    unit: ChipUnit = NOISY
    settings: Mpu6050Settings = field(default_factory=Mpu6050Settings)
    smbus_only: bool = False
    seed: int = 1
    who_am_i: int = MPU6050_WHO_AM_I
    with_line: bool = False
    edges_ns: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.time = SimulatedTime()
        self.chip = Mpu6050Chip(self.motion, self.unit, self.time, self.seed, self.who_am_i)
        self.line = SimulatedDataReady(self, self.time, self.time.sleep, self.seed)
        self.wires = I2cWires({ADDRESS: self.chip}, smbus_only=self.smbus_only, elapse=self.time.sleep)
        self.imu = Mpu6050(
            self.wires.open,
            address=ADDRESS,
            settings=self.settings,
            open_data_ready=self.line.open if self.with_line else None,
            clock=self.time,
            sleep=self.time.sleep,
        )
        self._rng = np.random.default_rng(self.seed)

    def opened(self) -> "ImuBench":
        """Open the driver; return the bench itself."""
        self.imu.open()
        return self

    def poll(self) -> list[ImuSample]:
        """Read once and note the true sample instants."""
        samples = list(self.imu.read(timeout_s=0.0))
        self.take_edges()
        return samples

    def take_edges(self) -> list[int]:
        """Return the chip's new edges and note them: the line's source, tapped for the truth."""
        edges = self.chip.take_edges()
        self.edges_ns += edges
        return edges

    def next_edge_ns(self) -> int | None:
        """Return when the chip's next edge will be."""
        return self.chip.next_edge_ns()

    def follow(self, duration_s: float, timeout_s: float = 0.1) -> list[ImuSample]:
        """Read as the daemon does: wait in the driver, woken late by 0.1 ms on average and now and then by 10 ms."""
        samples: list[ImuSample] = []
        end_ns = self.time.now_ns + round(duration_s * 1e9)
        while self.time.now_ns < end_ns:
            samples += self.imu.read(timeout_s)
            self.take_edges()
            self.time.sleep(float(self._rng.exponential(0.0001) + 0.010 * (self._rng.random() < 0.005)))
        return samples

    def run(self, duration_s: float, *, poll_s: float = 0.005, jittery: bool = True) -> list[ImuSample]:
        """Poll on a grid, late by an exponential delay of mean 1 ms and now and then by 10 ms more."""
        samples: list[ImuSample] = []
        start_ns, due_s = self.time.now_ns, 0.0
        while due_s < duration_s:
            late_s = float(self._rng.exponential(0.001) + 0.010 * (self._rng.random() < 0.005)) if jittery else 0.0
            self.time.now_ns = max(self.time.now_ns, start_ns + round((due_s + late_s) * 1e9))
            samples += self.poll()
            due_s += poll_s
        return samples

    def pause(self, duration_s: float) -> None:
        """Let time pass without reading; the chip goes on."""
        while duration_s > 0.0:
            self.time.sleep(min(duration_s, 1.0))
            self.take_edges()
            duration_s -= 1.0

    def filter_delay_ns(self) -> int:
        """Return the delay that the driver takes off."""
        return round(self.imu.filter_delay_s * 1e9)

    def stamp_errors_s(self, samples: list[ImuSample]) -> FloatArray:
        """Return how late (> 0) each stamp is against the nearest true sample instant."""
        stamps = np.array([sample.t_sample_ns for sample in samples]) + self.filter_delay_ns()
        edges = np.array(self.edges_ns)
        after = np.clip(np.searchsorted(edges, stamps), 1, edges.size - 1)
        before = after - 1
        nearest = np.where(stamps - edges[before] < edges[after] - stamps, edges[before], edges[after])
        return (stamps - nearest) * 1e-9

    def time_offset_s(self, samples: list[ImuSample]) -> float:
        """Return how late (> 0) the stamps are against the motion itself, by least squares on all axes."""
        t_ns = np.array([sample.t_sample_ns for sample in samples])
        step_ns = 100_000
        measured = np.array([[*sample.sf_B_mps2, *sample.w_WB_B_radps] for sample in samples])
        now, later, earlier = (np.hstack(self.motion(t_ns + shift)) for shift in (0, step_ns, -step_ns))
        slope = (later - earlier) / (2e-9 * step_ns)
        return float(np.sum((now - measured) * slope) / np.sum(slope**2))


def lost_by_truth(bench: ImuBench, samples: list[ImuSample]) -> int:
    """Return how many of the chip's samples between the first and the last delivered one were not delivered."""
    delay_ns = bench.filter_delay_ns()
    half_ns = round(0.5e9 * bench.imu.period_s)
    first, last = samples[0].t_sample_ns + delay_ns - half_ns, samples[-1].t_sample_ns + delay_ns + half_ns
    return sum(first < edge < last for edge in bench.edges_ns) - len(samples)
