"""The service on pictures that were rendered beforehand: it asks of the host what a unit does, with no renderer beside.

    python -m lab.faults.steady_service SECONDS

Device "demo", priorities as a unit has them where the host grants them, CAN inside the process. The wearer stands; the
same second of pictures comes again and again, so that whether they are valid says nothing.
"""

import itertools
import signal
import sys
import time
from collections.abc import Sequence
from types import FrameType

import msgspec

from daemon.config import Configuration
from daemon.pipeline import Pipeline
from daemon.publish_can import CanPublisher
from daemon.publish_zenoh import ZenohPublisher
from daemon.service import Devices, Service
from daemon.stamping import Stamper
from drivers.boot_id import read_boot_id
from drivers.can.link import CanLink
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from messages import TOPIC_OF, DropCause, Source, StereoFrame
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

DEVICE = "demo"
READY = "publishing"
_PERIOD_NS = TOPIC_OF[StereoFrame].period_ns
_DELAY_NS = 35_000_000
"""From exposure to arrival."""
_LEAD_NS = 2_000_000_000


class PlayedCamera:
    """Gives `frames` over and over, one each 50 ms, as if they were new."""

    def __init__(self, frames: Sequence[StereoFrame]) -> None:
        self.dropped: dict[DropCause, int] = {}
        self._frames = itertools.cycle(frames)
        self._seq = 0
        self._due_ns = time.monotonic_ns()

    def read(self, timeout_s: float) -> StereoFrame | None:
        """Return the frame that is due, or None after `timeout_s`; a thread that came late skips those it missed."""
        wait_s = 1e-9 * (self._due_ns - time.monotonic_ns())
        time.sleep(max(0.0, min(wait_s, timeout_s)))
        if wait_s > timeout_s:
            return None
        now_ns = time.monotonic_ns()
        missed = (now_ns - self._due_ns) // _PERIOD_NS
        due_ns = self._due_ns + missed * _PERIOD_NS
        self._due_ns = due_ns + _PERIOD_NS
        self._seq += 1 + missed
        frame = next(self._frames)
        header = msgspec.structs.replace(
            frame.header, seq=self._seq, t_exposure_ns=due_ns - _DELAY_NS, t_arrival_ns=now_ns
        )
        return msgspec.structs.replace(frame, header=header)

    def close(self) -> None:
        """Release nothing."""


def main() -> None:
    """Run for as long as the argument says, or until SIGTERM."""
    configuration = Configuration(device=DEVICE)
    walk = scenario("standing")
    offline = SimulatedWearer(1, walk, 0)
    frames = [message for message in offline.offline_inputs(1.0) if isinstance(message, StereoFrame)]
    offline.close()
    wearer = SimulatedWearer(1, walk, time.monotonic_ns() + _LEAD_NS)
    imu = Mpu6050(wearer.imu_bus, settings=Mpu6050Settings(), open_data_ready=wearer.data_ready.open)
    imu.open()
    zenoh = ZenohPublisher(configuration.zenoh, DEVICE, calibration=wearer.calibration, configuration=configuration)
    can = CanPublisher(CanLink(configuration.can))
    service = Service(
        Pipeline(wearer.calibration, configuration.foothold),
        Devices(imu=imu, camera=PlayedCamera(frames)),
        [zenoh, can],
        Stamper(DEVICE, read_boot_id(), Source.SIMULATED),
        background={"can": can.drain},
        priorities=True,
        zenoh_health=lambda: zenoh.health,
    )

    def stop(_number: int, _frame: FrameType | None) -> None:
        service.stop()

    signal.signal(signal.SIGTERM, stop)
    print(READY, flush=True)
    service.run(float(sys.argv[1]))
    wearer.close()


if __name__ == "__main__":
    main()
