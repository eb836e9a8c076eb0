"""Faults of the camera: its cable, its buffers and its time stamps."""

import errno
from collections.abc import Callable

from lab.faults.fault import (
    FRAME_FLAG_S,
    MOTION_FLAG_S,
    RECOVERY_S,
    USB_RECOVERY_S,
    Expect,
    Fault,
    HardwareAction,
    Layer,
)
from lab.faults.faulty_camera import TRANSFER_S
from lab.faults.hardware import FaultyHardware
from sim_rig.camera.v4l2_node import Fault as FrameFault


def _frames_with(which: Callable[[int], bool], fault: FrameFault) -> HardwareAction:
    """Let `fault` happen to the frames k for which `which` says so."""

    def inject(hardware: FaultyHardware) -> None:
        hardware.camera.frame_faults["fault"] = lambda k: fault if which(k) else None

    return HardwareAction(inject, lambda hardware: hardware.camera.frame_faults.clear())


def _stamped(by_s: float) -> HardwareAction:
    def stamp(hardware: FaultyHardware, shift_s: float) -> None:
        hardware.camera.node.stamp_jitter_s = lambda _frame: shift_s

    return HardwareAction(lambda hardware: stamp(hardware, by_s), lambda hardware: stamp(hardware, 0.0))


def _stepping(by_s: float, frames: int) -> HardwareAction:
    """Let the camera's clock step by `by_s` to and fro, every so many frames."""

    def stamp(hardware: FaultyHardware, shift_s: float) -> None:
        hardware.camera.node.stamp_jitter_s = lambda frame: shift_s * (frame // frames % 2)

    return HardwareAction(lambda hardware: stamp(hardware, by_s), lambda hardware: stamp(hardware, 0.0))


def _later(by_s: float) -> HardwareAction:
    def transfer(hardware: FaultyHardware, seconds: float) -> None:
        hardware.camera.node.transfer_s = seconds

    return HardwareAction(
        lambda hardware: transfer(hardware, TRANSFER_S + by_s), lambda hardware: transfer(hardware, TRANSFER_S)
    )


def _slower(period_s: float) -> HardwareAction:
    def expose(hardware: FaultyHardware, seconds: float) -> None:
        hardware.camera.node.slow_period_s = seconds

    return HardwareAction(lambda hardware: expose(hardware, period_s), lambda hardware: expose(hardware, 0.0))


def _unplugged() -> HardwareAction:
    """Pull the cable with the next frame."""

    def inject(hardware: FaultyHardware) -> None:
        hardware.camera.frame_faults["cable"] = lambda _k: FrameFault.UNPLUG

    return HardwareAction(inject, _plugged_in)


def _busy() -> HardwareAction:
    """Let the camera be enumerated anew, and another program open it first."""

    def inject(hardware: FaultyHardware) -> None:
        hardware.camera.node.held = True
        hardware.camera.node.unplug()
        hardware.camera.node.plug_in()

    return HardwareAction(inject, _plugged_in)


def _plugged_in(hardware: FaultyHardware) -> None:
    hardware.camera.frame_faults.pop("cable", None)
    hardware.camera.node.held = False
    hardware.camera.node.plug_in()


def _dequeue_failing(error: int) -> HardwareAction:
    def fail(hardware: FaultyHardware, with_error: int) -> None:
        hardware.camera.kernel.dequeue_error = with_error

    return HardwareAction(lambda hardware: fail(hardware, error), lambda hardware: fail(hardware, 0))


def _silent() -> HardwareAction:
    def hush(hardware: FaultyHardware, silent: bool) -> None:
        hardware.camera.kernel.silent = silent

    return HardwareAction(lambda hardware: hush(hardware, True), lambda hardware: hush(hardware, False))


def missing(
    name: str, how: str, act: HardwareAction, touches: str, hold_s: float = 1.5, recovery_s: float = RECOVERY_S
) -> Fault:
    """Return a fault that leaves no usable frame."""
    return Fault(
        name=name,
        layer=Layer.CAMERA,
        how=how,
        act=act,
        expect=Expect.FLAGGED,
        limit_s=FRAME_FLAG_S,
        hold_s=hold_s,
        recovery_s=recovery_s,
        touches=touches,
    )


def contradiction(name: str, how: str, act: HardwareAction, touches: str) -> Fault:
    """Return a fault whose frames contradict the IMU or each other once the wearer walks."""
    return Fault(
        name=name,
        layer=Layer.CAMERA,
        how=how,
        act=act,
        expect=Expect.FLAGGED,
        limit_s=MOTION_FLAG_S,
        hold_s=6.0,
        in_motion=True,
        touches=touches,
    )


def other(
    name: str,
    how: str,
    act: HardwareAction,
    expect: Expect,
    reason: str,
    touches: str,
    hold_s: float = 3.0,
    share: float = 1.0,
) -> Fault:
    """Return a fault that is tolerated, may be flagged or not, or goes unnoticed."""
    return Fault(
        name=name,
        layer=Layer.CAMERA,
        how=how,
        act=act,
        expect=expect,
        hold_s=hold_s,
        in_motion=True,
        reason=reason,
        touches=touches,
        share=share,
    )


STREAM_FAULTS = (
    missing("cam-unplugged-2s", "the cable is unplugged for 2 s", _unplugged(), "stream", 2.0, USB_RECOVERY_S),
    missing("cam-unplugged-10s", "the cable is unplugged for 10 s", _unplugged(), "stream", 10.0, USB_RECOVERY_S),
    missing(
        "cam-busy",
        "the camera is re-enumerated and another program opens it first (EBUSY)",
        _busy(),
        "stream",
        2.0,
        USB_RECOVERY_S,
    ),
    missing("cam-dequeue-eio", "VIDIOC_DQBUF fails with EIO", _dequeue_failing(errno.EIO), "call"),
    missing("cam-dequeue-enodev", "VIDIOC_DQBUF fails with ENODEV", _dequeue_failing(errno.ENODEV), "call"),
    missing("cam-silent", "the camera streams without ever filling a buffer, for 4 s", _silent(), "call", 4.0),
    missing(
        "cam-error-flags",
        "every buffer carries the error flag",
        _frames_with(lambda _k: True, FrameFault.ERROR),
        "buffers",
    ),
    missing(
        "cam-short-buffers",
        "every buffer holds less than a whole frame",
        _frames_with(lambda _k: True, FrameFault.SHORT),
        "buffers",
    ),
    missing(
        "cam-all-lost",
        "no frame arrives, though the sequence numbers go on",
        _frames_with(lambda _k: True, FrameFault.LOST),
        "buffers",
    ),
    missing(
        "cam-three-of-four-lost",
        "three frames of four are lost",
        _frames_with(lambda k: k % 4 != 0, FrameFault.LOST),
        "buffers",
    ),
    other(
        "cam-10fps",
        "the camera exposes longer: 10 frames a second",
        _slower(0.1),
        Expect.HONEST,
        "half the frames give half the estimates; a gap above 120 ms is flagged",
        "rate",
        2.0,
    ),
    other(
        "cam-every-second-lost",
        "every second frame is lost",
        _frames_with(lambda k: k % 2 == 0, FrameFault.LOST),
        Expect.HONEST,
        "half the frames give half the estimates; a gap above 120 ms is flagged",
        "buffers",
        2.0,
    ),
    other(
        "cam-gaps",
        "every fifth frame is lost",
        _frames_with(lambda k: k % 5 == 0, FrameFault.LOST),
        Expect.TOLERATED,
        "the next frame comes in time",
        "buffers",
        2.0,
        share=0.8,
    ),
    other(
        "cam-some-errors",
        "every fourth buffer carries the error flag",
        _frames_with(lambda k: k % 4 == 0, FrameFault.ERROR),
        Expect.TOLERATED,
        "the next frame comes in time",
        "buffers",
        2.0,
        share=0.75,
    ),
    other(
        "cam-late-80ms",
        "frames arrive 80 ms later than usual",
        _later(0.080),
        Expect.HONEST,
        "their time stamps are right, and the consumer sees their age",
        "transport",
        2.0,
    ),
    missing("cam-late-300ms", "frames arrive 300 ms later than usual", _later(0.300), "transport"),
)

STAMP_FAULTS = (
    *(
        contradiction(
            f"cam-stamps-{'ahead' if by_ms > 0 else 'behind'}-{abs(by_ms)}ms",
            f"the frames' time stamps jump by {by_ms:+d} ms and stay shifted",
            _stamped(1e-3 * by_ms),
            "stamps",
        )
        for by_ms in (20, 50, 200, -20, -50, -200)
    ),
    contradiction(
        "cam-clock-steps",
        "the camera's clock steps by 30 ms to and fro, twice a second",
        _stepping(0.030, 5),
        "stamps",
    ),
    missing(
        "cam-stamps-realtime",
        "time stamps are of CLOCK_REALTIME, decades ahead",
        _frames_with(lambda _k: True, FrameFault.REALTIME_STAMP),
        "buffers",
    ),
    missing(
        "cam-stamps-old",
        "time stamps are one second old",
        _frames_with(lambda _k: True, FrameFault.OLD_STAMP),
        "buffers",
    ),
)

CAMERA_FAULTS = STREAM_FAULTS + STAMP_FAULTS
