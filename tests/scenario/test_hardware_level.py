"""The daemon's own drivers from end to end: ioctls and register reads in, protected CAN frames out, in real time."""

import time
from collections.abc import Iterator
from contextlib import closing

import can
import cv2
import numpy as np
import pytest

from daemon.pipeline import Pipeline
from daemon.publish_can import CanPublisher
from daemon.service import Devices, Service
from daemon.stamping import Stamper
from drivers.boot_id import read_boot_id
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.v4l2_device import LinuxKernel
from drivers.can.link import CanLink
from drivers.can.settings import CanInterface, CanSettings
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from messages import Reason, Source
from messages.can_estimates import ReceivedGround
from messages.can_receiver import CanReceiver
from messages.refusal import Refusal
from perception.ground.foothold import FootholdSettings
from sim_rig.camera.v4l2_node import V4l2Node
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

pytestmark = pytest.mark.realtime

BUS = CanSettings(interface=CanInterface.VIRTUAL, channel="hardware-level")


@pytest.fixture
def wearer() -> Iterator[SimulatedWearer]:
    with closing(SimulatedWearer(5, scenario("standing"), time.monotonic_ns())) as simulated:
        yield simulated


def heard(bus: can.BusABC, receiver: CanReceiver[ReceivedGround]) -> list[ReceivedGround | str]:
    """Return what the frames waiting on the bus say: estimates, or the reason why there is none."""
    found = list[ReceivedGround | str]()
    while (frame := bus.recv(0.0)) is not None:
        ground = receiver.feed(frame.arbitration_id, bytes(frame.data), time.monotonic_ns())
        if ground is Refusal.NOT_VALID:
            found.append(receiver.reason)
        elif not isinstance(ground, Refusal):
            found.append(ground)
    return found


def test_a_standing_wearer_is_heard_on_can_and_an_unplugged_camera_falls_silent(wearer: SimulatedWearer) -> None:
    # one picture with noise that changes, of which every third is taken: a wearer who stands sways by millimetres
    ((still, truth),) = wearer.frames(1)
    noise = np.random.default_rng(1).integers(0, 3, (2, 2, *still.left.shape), dtype=np.uint8)
    pictures = [(cv2.add(still.left, left), cv2.add(still.right, right)) for left, right in noise]
    node = V4l2Node(lambda frame: pictures[frame % 2], LinuxKernel())
    imu = Mpu6050(wearer.imu_bus, settings=Mpu6050Settings())
    imu.open()
    stereo = wearer.calibration.stereo
    camera = V4l2StereoCamera(
        node.path,
        stereo.left.width_px,
        stereo.left.height_px,
        pool_frames=8,
        stamp_to_mid_exposure_s=stereo.stamp_to_mid_exposure_s,
        kernel=node,
    )
    publisher = CanPublisher(CanLink(BUS))
    service = Service(
        Pipeline(wearer.calibration, FootholdSettings()),
        Devices(imu=imu, camera=camera),
        [publisher],
        Stamper("test", read_boot_id(), Source.LIVE),
        background={"can": publisher.drain},
    )
    receiver, grounds, after = CanReceiver(ReceivedGround), list[ReceivedGround](), list[ReceivedGround | str]()
    unplugged = False
    silence = [Reason.NO_FRAME.value] * 20  # one second

    with can.Bus(BUS.channel, BUS.interface.value) as bus:

        def story() -> None:
            nonlocal unplugged
            found = heard(bus, receiver)
            if unplugged:
                after.extend(found)
                if after[-len(silence) :] == silence:  # before it comes what was on its way
                    service.stop()
            else:
                grounds.extend(ground for ground in found if isinstance(ground, ReceivedGround))
                if len(grounds) >= 10:
                    node.unplug()
                    unplugged = True

        service.run(30.0, each_s=0.02, status=story)

    assert len(grounds) >= 10
    for ground in grounds:
        assert ground.source is Source.LIVE
        assert ground.height_m == pytest.approx(truth.height_m, abs=0.02)
        assert abs(ground.slope_sagittal_rad) < 0.035
    assert after[-len(silence) :] == silence, after
    assert sum(isinstance(said, ReceivedGround) for said in after) <= 6, after  # 0.3 s
