"""The catalogue's surroundings: CAN, Zenoh and the host that the daemon runs on."""

from lab.faults.adapter import PtyAdapter
from lab.faults.fault import USB_RECOVERY_S, Expect, Fault, Layer, Outside, Tamper

_PERCEPTION_GOES_ON = "sending never blocks perception: Zenoh goes on, and CAN does once the cause is gone"


def _adapter(switch: str) -> Outside:
    """Turn a switch of the adapter on and off."""

    def turn(adapter: PtyAdapter, on: bool) -> None:
        setattr(adapter, switch, on)

    return Outside(lambda around: turn(around.adapter, True), lambda around: turn(around.adapter, False))


def _can(name: str, how: str, act: Outside, hold_s: float = 1.5, recovery_s: float = 2.0) -> Fault:
    return Fault(
        name=name,
        layer=Layer.CAN,
        how=how,
        act=act,
        expect=Expect.TOLERATED,
        hold_s=hold_s,
        recovery_s=recovery_s,
        reason=_PERCEPTION_GOES_ON,
        touches="can",
    )


CAN_FAULTS = (
    _can(
        "can-adapter-gone",
        "the adapter is unplugged for 2 s and comes back as another terminal under its lasting name",
        Outside(lambda around: around.adapter.unplug(), lambda around: around.adapter.plug_in()),
        2.0,
        USB_RECOVERY_S,
    ),
    _can("can-adapter-stuck", "the adapter takes nothing for 8 s, its port runs full", _adapter("stuck"), 8.0),
    _can("can-flood", "2,000 foreign frames a second", _adapter("flooding")),
    _can("can-garbage", "10,000 bytes a second that are no frames", _adapter("babbling")),
    _can("can-ankle-corrupted", "each state of the ankle has a bit flipped", _adapter("ankle_corrupted")),
    _can("can-ankle-replayed", "one state of the ankle is sent over and over", _adapter("ankle_replayed")),
)

ZENOH_FAULTS = (
    Fault(
        name="zenoh-subscriber-asleep",
        layer=Layer.ZENOH,
        how="a subscriber to everything is stopped and takes nothing any more",
        act=Outside(lambda around: around.start_subscribers(1, asleep=True), lambda around: around.end_programs()),
        expect=Expect.TOLERATED,
        hold_s=4.0,
        reason="what it does not take is dropped for it alone",
        touches="zenoh",
    ),
    Fault(
        name="zenoh-subscriber-flood",
        layer=Layer.ZENOH,
        how="40 sessions subscribe to everything at once",
        act=Outside(lambda around: around.start_subscribers(40), lambda around: around.end_programs()),
        expect=Expect.HONEST,
        hold_s=4.0,
        reason="their sessions cost the two cores what they cost; frames may be given up, never sent late",
        touches="zenoh",
    ),
)


def _paused(seconds: float) -> Fault:
    return Fault(
        name=f"host-paused-{seconds:g}s",
        layer=Layer.HOST,
        how=f"SIGSTOP, and SIGCONT {seconds:g} s later",
        act=Outside(lambda around: around.pause_daemon(), lambda around: around.resume_daemon()),
        expect=Expect.SILENT,
        hold_s=seconds,
        reason="who is stopped cannot speak; the consumer's own age limit is the flag",
        touches="process",
    )


def _busy(count: int) -> Fault:
    return Fault(
        name=f"host-busy-{count}",
        layer=Layer.HOST,
        how=f"{count} other program{'s' if count > 1 else ''} computing without end",
        act=Outside(lambda around: around.start_busy_programs(count), lambda around: around.end_programs()),
        expect=Expect.HONEST,
        hold_s=4.0,
        reason="two cores are shared with the rig; frames may be given up, never sent late",
        touches="processor",
    )


def _wall_clock(word: str, by_s: float) -> Fault:
    return Fault(
        name=f"host-wall-clock-{word}",
        layer=Layer.HOST,
        how=f"CLOCK_REALTIME is set {word} by an hour, as the process sees it",
        act=Tamper(lambda bench: bench.shift_wall_clock(by_s), lambda bench: bench.shift_wall_clock(0.0)),
        expect=Expect.TOLERATED,
        reason="every time is of CLOCK_MONOTONIC; a reception stamp that makes no sense is not believed",
        touches="wall clock",
    )


HOST_FAULTS = (
    _paused(0.3),
    _paused(2.0),
    Fault(
        name="host-killed",
        layer=Layer.HOST,
        how="SIGKILL; the service manager starts the daemon again while the wearer walks",
        act=Outside(lambda around: around.kill_daemon(), lambda around: around.restart()),
        expect=Expect.SILENT,
        hold_s=0.5,
        recovery_s=USB_RECOVERY_S,
        reason="who is dead cannot speak; the consumer's own age limit is the flag",
    ),
    _busy(1),
    _busy(2),
    Fault(
        name="host-memory",
        layer=Layer.HOST,
        how="another program takes 1 GB and touches it",
        act=Outside(lambda around: around.start_greedy_program(1 << 30), lambda around: around.end_programs()),
        expect=Expect.TOLERATED,
        hold_s=3.0,
        reason="there is memory enough; the service locks its own",
        touches="processor",
    ),
    Fault(
        name="host-interpreter-hogged",
        layer=Layer.HOST,
        how="a thread of pure Python computes without end inside the daemon",
        act=Tamper(lambda bench: bench.hog_interpreter(), lambda bench: bench.release_interpreter()),
        expect=Expect.HONEST,
        hold_s=3.0,
        reason="the interpreter is handed over every 0.5 ms; frames may be given up, never sent late",
        touches="processor",
    ),
    _wall_clock("forward", 3600.0),
    _wall_clock("back", -3600.0),
)
