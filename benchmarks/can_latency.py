"""From a frame's arrival to its ground, and its set-point, on CAN: by the clock, of a service that runs.

    python -m benchmarks.can_latency [--seeds 1001 1002] [--seconds 12]

A walk of the rig is rendered first, 37 MB a second; its messages then come to a service in this process at the times
that they have in it, so that no renderer runs beside. To be run on an idle machine: waiting for other work is in the
figures, as is waiting for an IMU sample later than the exposure. What a bus of 500 kbit/s takes is not: 0.27 ms for
each of a ground's two frames and of a set-point's six.
"""

import argparse
import time
from bisect import bisect_left
from collections.abc import Sequence

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from daemon.publish_can import CanPublisher
from daemon.service import Devices, Service
from daemon.setpoints import SetpointSettings, modulator
from daemon.stamping import Stamper
from drivers.can.link import CanLink, SendResult
from drivers.can.settings import CanSettings
from drivers.imu.mpu6050 import Mpu6050Counters
from messages import DropCause, Estimate, GroundPlane, ImuSample, Setpoint, Source, Stamp, StereoFrame
from messages.can_frames import CanFrame, CanMessage, can_id
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.terrain_walks import STANDING_S, terrain_walk
from sim_rig.wearer import SimulatedWearer

RIG_NS = 10_000_000_000
LEAD_NS = 1_000_000_000
Sent = type[GroundPlane] | type[Setpoint]
SENT_AS: dict[Sent, tuple[list[int], int]] = {
    GroundPlane: ([can_id(CanMessage.GROUND), can_id(CanMessage.GROUND_QUALITY)], 2),
    Setpoint: ([can_id(CanMessage.SETPOINT), can_id(CanMessage.SETPOINT_QUALITY)], 6),
}
"""On which identifiers an estimate goes, in so many frames."""


class PlayedImu:
    """Gives `samples` once their arrival is past."""

    filter_delay_s = 0.0

    def __init__(self, samples: Sequence[ImuSample]) -> None:
        self.counters = Mpu6050Counters()
        self._samples, self._given = samples, 0

    def read(self, timeout_s: float) -> Sequence[ImuSample]:
        """Return those that are due, none where the next is not within `timeout_s`."""
        if self._given == len(self._samples):
            time.sleep(timeout_s)
            return []
        _sleep_until(self._samples[self._given].t_arrival_ns, timeout_s)
        begin, now_ns = self._given, time.monotonic_ns()
        while self._given < len(self._samples) and self._samples[self._given].t_arrival_ns <= now_ns:
            self._given += 1
        return self._samples[begin : self._given]

    def close(self) -> None:
        """Release nothing."""


class PlayedPair:
    """Gives each of `frames` once its arrival is past."""

    def __init__(self, frames: Sequence[StereoFrame]) -> None:
        self.dropped: dict[DropCause, int] = {}
        self._frames, self._given = frames, 0

    def read(self, timeout_s: float) -> StereoFrame | None:
        """Return the next, or None where it is not due within `timeout_s`."""
        if self._given == len(self._frames):
            time.sleep(timeout_s)
            return None
        frame = self._frames[self._given]
        _sleep_until(frame.header.t_arrival_ns, timeout_s)
        if frame.header.t_arrival_ns > time.monotonic_ns():
            return None
        self._given += 1
        return frame

    def close(self) -> None:
        """Release nothing."""


class TimedLink:
    """A CAN link that notes when it has taken each identifier's frames, ns."""

    def __init__(self, link: CanLink) -> None:
        self.taken_ns: dict[int, list[int]] = {}
        self._link = link

    def send(self, frame: CanFrame) -> SendResult:
        """Send one frame."""
        result = self._link.send(frame)
        self.taken_ns.setdefault(frame.can_id, []).append(time.monotonic_ns())
        return result

    def close(self) -> None:
        """Release the bus."""
        self._link.close()


class TimedPublisher(CanPublisher):
    """Notes when it was left what, by the exposure that it stands for, ns."""

    def __init__(self, link: TimedLink) -> None:
        super().__init__(link)
        self.left_ns: dict[Sent, dict[int, int]] = {kind: {} for kind in SENT_AS}

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:
        """Leave `estimate` to be sent."""
        if isinstance(estimate, GroundPlane | Setpoint):
            # What withdraws an estimate that is due no more stands for the same exposure: the first counts.
            self.left_ns[type(estimate)].setdefault(estimate.t_exposure_ns, time.monotonic_ns())
        super().publish(estimate, stamp)


def _sleep_until(due_ns: int, timeout_s: float) -> None:
    time.sleep(max(0.0, min(timeout_s, 1e-9 * (due_ns - time.monotonic_ns()))))


def latencies_ms(kind: Sent, played: Sequence[StereoFrame], can: TimedPublisher, link: TimedLink) -> list[float]:
    """Return for each of the frames `played` how long after its arrival the last CAN frame of its estimate was taken;
    those whose estimate another replaced are left out."""
    identifiers, frames = SENT_AS[kind]
    taken_ns = sorted(t_ns for identifier in identifiers for t_ns in link.taken_ns.get(identifier, []))
    left_ns, found = can.left_ns[kind], []
    next_left_ns = dict(zip(left_ns.values(), [*list(left_ns.values())[1:], 2**62], strict=True))
    for frame in played:
        at_ns = left_ns.get(frame.header.t_exposure_ns)
        if at_ns is None:
            continue
        last = bisect_left(taken_ns, at_ns) + frames - 1
        if last < len(taken_ns) and taken_ns[last] < next_left_ns[at_ns]:
            found.append(1e-6 * (taken_ns[last] - frame.header.t_arrival_ns))
    return found


def run_walk(seed: int, seconds: float) -> dict[Sent, list[float]]:
    """Return the latencies, ms, of one walk's estimates."""
    walk = terrain_walk(seed)
    wearer = SimulatedWearer(seed, walk.scenario, RIG_NS)
    inputs = list(wearer.offline_inputs(min(seconds, walk.seconds)))
    shift_ns = time.monotonic_ns() + LEAD_NS - RIG_NS
    samples, frames = list[ImuSample](), list[StereoFrame]()
    for message in inputs:
        if isinstance(message, ImuSample):
            moved = {"t_sample_ns": message.t_sample_ns + shift_ns, "t_arrival_ns": message.t_arrival_ns + shift_ns}
            samples.append(msgspec.structs.replace(message, **moved))
        elif isinstance(message, StereoFrame):
            times = message.header
            header = msgspec.structs.replace(
                times, t_exposure_ns=times.t_exposure_ns + shift_ns, t_arrival_ns=times.t_arrival_ns + shift_ns
            )
            frames.append(msgspec.structs.replace(message, header=header))
    link = TimedLink(CanLink(CanSettings()))
    can = TimedPublisher(link)
    pipeline = Pipeline(wearer.calibration, FootholdSettings(), setpoints=modulator(SetpointSettings(mass_kg=75.0)))
    service = Service(
        pipeline,
        Devices(imu=PlayedImu(samples), camera=PlayedPair(frames)),
        [can],
        Stamper("unit", "", Source.SIMULATED),
        background={"can": can.drain},
        priorities=True,
    )
    service.run(1e-9 * (frames[-1].header.t_arrival_ns - time.monotonic_ns()) + 0.2)
    walked = [f for f in frames if f.header.t_exposure_ns - shift_ns > RIG_NS + round(1e9 * STANDING_S)]
    return {kind: latencies_ms(kind, walked, can, link) for kind in SENT_AS}


def main() -> None:
    """Print the spread over the walks of the chosen seeds."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--seeds", type=int, nargs="+", default=[1001, 1002])
    options.add_argument("--seconds", type=float, default=12.0)
    chosen = options.parse_args()
    cv2.setNumThreads(1)
    walks = [run_walk(seed, chosen.seconds) for seed in chosen.seeds]
    print("| | frames | p50, ms | P99, ms | most, ms |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for kind in SENT_AS:
        taken = [each for walk in walks for each in walk[kind]]
        p50, p99, most = (float(each) for each in (*np.percentile(taken, [50, 99]), max(taken)))
        print(f"| {kind.__name__} | {len(taken)} | {p50:.1f} | {p99:.1f} | {most:.1f} |")


if __name__ == "__main__":
    main()
