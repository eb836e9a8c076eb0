"""The catalogue's camera: its cable, its buffers and its stamps."""

import errno
from collections.abc import Callable

from lab.faults.bench import Bench
from lab.faults.fault import (
    FRAME_FLAG_S,
    MOTION_FLAG_S,
    RECOVERY_S,
    USB_RECOVERY_S,
    Expect,
    Fault,
    Layer,
    Tamper,
)
from lab.faults.played_camera import TRANSFER_S
from sim_rig.camera.v4l2_node import Fault as FrameFault


def _befalling(which: Callable[[int], bool], fault: FrameFault) -> Tamper:
    """Let `fault` befall the frames k for which `which` says so."""

    def inject(bench: Bench) -> None:
        bench.camera.mishaps["fault"] = lambda k: fault if which(k) else None

    return Tamper(inject, lambda bench: bench.camera.mishaps.clear())


def _stamped(by_s: float) -> Tamper:
    def stamp(bench: Bench, shift_s: float) -> None:
        bench.camera.node.stamp_jitter_s = lambda _frame: shift_s

    return Tamper(lambda bench: stamp(bench, by_s), lambda bench: stamp(bench, 0.0))


def _later(by_s: float) -> Tamper:
    def transfer(bench: Bench, seconds: float) -> None:
        bench.camera.node.transfer_s = seconds

    return Tamper(lambda bench: transfer(bench, TRANSFER_S + by_s), lambda bench: transfer(bench, TRANSFER_S))


def _slower(period_s: float) -> Tamper:
    def expose(bench: Bench, seconds: float) -> None:
        bench.camera.node.slow_period_s = seconds

    return Tamper(lambda bench: expose(bench, period_s), lambda bench: expose(bench, 0.0))


def _unplugged() -> Tamper:
    """Pull the cable with the next frame."""

    def inject(bench: Bench) -> None:
        bench.camera.mishaps["cable"] = lambda _k: FrameFault.UNPLUG

    return Tamper(inject, _plugged_in)


def _busy() -> Tamper:
    """Let the camera be enumerated anew, and another program open it first."""

    def inject(bench: Bench) -> None:
        bench.camera.node.held = True
        bench.camera.node.unplug()
        bench.camera.node.plug_in()

    return Tamper(inject, _plugged_in)


def _plugged_in(bench: Bench) -> None:
    bench.camera.mishaps.pop("cable", None)
    bench.camera.node.held = False
    bench.camera.node.plug_in()


def _dequeue_failing(error: int) -> Tamper:
    def fail(bench: Bench, with_error: int) -> None:
        bench.camera.kernel.dequeue_error = with_error

    return Tamper(lambda bench: fail(bench, error), lambda bench: fail(bench, 0))


def _silent() -> Tamper:
    def hush(bench: Bench, silent: bool) -> None:
        bench.camera.kernel.silent = silent

    return Tamper(lambda bench: hush(bench, True), lambda bench: hush(bench, False))


def missing(
    name: str, how: str, act: Tamper, touches: str, hold_s: float = 1.5, recovery_s: float = RECOVERY_S
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


def contradiction(name: str, how: str, act: Tamper, touches: str) -> Fault:
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
    act: Tamper,
    expect: Expect,
    reason: str,
    touches: str,
    hold_s: float = 3.0,
    share: float = 1.0,
) -> Fault:
    """Return a fault that is tolerated, that may go either way, or that goes unnoticed."""
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
    missing("cam-unplugged-2s", "the cable is out for 2 s", _unplugged(), "stream", 2.0, USB_RECOVERY_S),
    missing("cam-unplugged-10s", "the cable is out for 10 s", _unplugged(), "stream", 10.0, USB_RECOVERY_S),
    missing(
        "cam-busy",
        "re-enumerated, and another program was quicker (EBUSY)",
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
        _befalling(lambda _k: True, FrameFault.ERROR),
        "buffers",
    ),
    missing("cam-short-buffers", "every buffer is short", _befalling(lambda _k: True, FrameFault.SHORT), "buffers"),
    missing(
        "cam-all-lost",
        "no frame arrives though the sequence goes on",
        _befalling(lambda _k: True, FrameFault.LOST),
        "buffers",
    ),
    missing(
        "cam-three-of-four-lost",
        "three frames of four are lost",
        _befalling(lambda k: k % 4 != 0, FrameFault.LOST),
        "buffers",
    ),
    other(
        "cam-10fps",
        "the camera exposes longer: 10 frames a second",
        _slower(0.1),
        Expect.HONEST,
        "half the frames are half the ground; a gap beyond 120 ms is called one",
        "rate",
        2.0,
    ),
    other(
        "cam-every-second-lost",
        "every second frame is lost",
        _befalling(lambda k: k % 2 == 0, FrameFault.LOST),
        Expect.HONEST,
        "half the frames are half the ground; a gap beyond 120 ms is called one",
        "buffers",
        2.0,
    ),
    other(
        "cam-gaps",
        "every fifth frame is lost",
        _befalling(lambda k: k % 5 == 0, FrameFault.LOST),
        Expect.TOLERATED,
        "the next frame is in time",
        "buffers",
        2.0,
        share=0.8,
    ),
    other(
        "cam-some-errors",
        "every fourth buffer carries the error flag",
        _befalling(lambda k: k % 4 == 0, FrameFault.ERROR),
        Expect.TOLERATED,
        "the next frame is in time",
        "buffers",
        2.0,
        share=0.75,
    ),
    other(
        "cam-late-80ms",
        "frames arrive 80 ms later than usual",
        _later(0.080),
        Expect.HONEST,
        "their stamps are right; the consumer sees their age",
        "transport",
        2.0,
    ),
    missing("cam-late-300ms", "frames arrive 300 ms later than usual", _later(0.300), "transport"),
)

STAMP_FAULTS = (
    *(
        contradiction(
            f"cam-stamps-{'ahead' if by_ms > 0 else 'behind'}-{abs(by_ms)}ms",
            f"the stamps jump by {by_ms:+d} ms and stay there",
            _stamped(1e-3 * by_ms),
            "stamps",
        )
        for by_ms in (20, 50, 200, -20, -50, -200)
    ),
    missing(
        "cam-stamps-realtime",
        "stamps are of CLOCK_REALTIME, decades ahead",
        _befalling(lambda _k: True, FrameFault.REALTIME_STAMP),
        "buffers",
    ),
    missing("cam-stamps-old", "stamps lie a second back", _befalling(lambda _k: True, FrameFault.OLD_STAMP), "buffers"),
)

CAMERA_FAULTS = STREAM_FAULTS + STAMP_FAULTS
