"""Faults around the daemon: CAN, Zenoh and the host that it runs on."""

from lab.faults.can_adapter import SimulatedCanAdapter
from lab.faults.fault import USB_RECOVERY_S, Expect, Fault, HardwareAction, Layer, OutsideAction

_PERCEPTION_GOES_ON = "sending never blocks perception: Zenoh goes on, and CAN resumes when the cause is gone"


def _adapter(switch: str) -> OutsideAction:
    """Turn a switch of the adapter on and off."""

    def turn(adapter: SimulatedCanAdapter, on: bool) -> None:
        setattr(adapter, switch, on)

    return OutsideAction(lambda around: turn(around.adapter, True), lambda around: turn(around.adapter, False))


def _can(name: str, how: str, act: OutsideAction, hold_s: float = 1.5, recovery_s: float = 2.0) -> Fault:
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
        "the CAN adapter is unplugged for 2 s and returns as another terminal device under its /dev/serial/by-id name",
        OutsideAction(lambda around: around.adapter.unplug(), lambda around: around.adapter.plug_in()),
        2.0,
        USB_RECOVERY_S,
    ),
    _can(
        "can-adapter-stuck",
        "the CAN adapter stops accepting data for 8 s; its port's buffer fills up",
        _adapter("stuck"),
        8.0,
    ),
    _can("can-flood", "2,000 CAN frames a second from other devices", _adapter("flooding")),
    _can("can-garbage", "10,000 bytes a second that are not CAN frames", _adapter("sending_garbage")),
    _can("can-ankle-corrupted", "every ankle state message has a flipped bit", _adapter("ankle_corrupted")),
    _can(
        "can-identifier-taken",
        "another device sends its own data under the identifiers of the ankle's state and of the ground",
        _adapter("identifiers_taken"),
    ),
    _can("can-ankle-replayed", "the same ankle state message is sent over and over", _adapter("ankle_replayed")),
)

ZENOH_FAULTS = (
    Fault(
        name="zenoh-subscriber-asleep",
        layer=Layer.ZENOH,
        how="a subscriber to all topics is stopped and no longer reads",
        act=OutsideAction(
            lambda around: around.start_subscribers(1, asleep=True), lambda around: around.end_programs()
        ),
        expect=Expect.TOLERATED,
        hold_s=4.0,
        reason="messages it does not read are dropped for it alone",
        touches="zenoh",
    ),
    Fault(
        name="zenoh-subscriber-flood",
        layer=Layer.ZENOH,
        how="40 sessions subscribe to all topics at once",
        act=OutsideAction(lambda around: around.start_subscribers(40), lambda around: around.end_programs()),
        expect=Expect.HONEST,
        hold_s=4.0,
        reason="the sessions need processor time; frames may be dropped, never sent late",
        touches="zenoh",
        burdens_host=True,
    ),
)


def _paused(seconds: float) -> Fault:
    return Fault(
        name=f"host-paused-{seconds:g}s",
        layer=Layer.HOST,
        how=f"the daemon is stopped by SIGSTOP for {seconds:g} s",
        act=OutsideAction(lambda around: around.pause_daemon(), lambda around: around.resume_daemon()),
        expect=Expect.SILENT,
        hold_s=seconds,
        reason="a stopped daemon sends nothing; the consumer's own age limit shows it",
        touches="process",
        burdens_host=True,
    )


def _busy(count: int) -> Fault:
    return Fault(
        name=f"host-busy-{count}",
        layer=Layer.HOST,
        how=f"{count} other program{'s' if count > 1 else ''} use all processor time they get",
        act=OutsideAction(lambda around: around.start_busy_programs(count), lambda around: around.end_programs()),
        expect=Expect.HONEST,
        hold_s=4.0,
        reason="the processor is shared with the simulation; frames may be dropped, never sent late",
        touches="processor",
        burdens_host=True,
    )


def _wall_clock(word: str, by_s: float) -> Fault:
    return Fault(
        name=f"host-wall-clock-{word}",
        layer=Layer.HOST,
        how=f"the wall clock (CLOCK_REALTIME) is set {word} by an hour, as the process sees it",
        act=HardwareAction(
            lambda hardware: hardware.shift_wall_clock(by_s), lambda hardware: hardware.shift_wall_clock(0.0)
        ),
        expect=Expect.TOLERATED,
        reason="all times are of CLOCK_MONOTONIC; an implausible reception time is not used",
        touches="wall clock",
    )


HOST_FAULTS = (
    _paused(0.3),
    _paused(2.0),
    Fault(
        name="host-killed",
        layer=Layer.HOST,
        how="the daemon is killed by SIGKILL; the service manager restarts it while the wearer walks",
        act=OutsideAction(lambda around: around.kill_daemon(), lambda around: around.restart()),
        expect=Expect.SILENT,
        hold_s=0.5,
        recovery_s=USB_RECOVERY_S,
        reason="a killed daemon sends nothing; the consumer's own age limit shows it",
        burdens_host=True,
    ),
    _busy(1),
    _busy(2),
    Fault(
        name="host-memory",
        layer=Layer.HOST,
        how="another program allocates 1 GB of memory and writes to it",
        act=OutsideAction(lambda around: around.start_greedy_program(1 << 30), lambda around: around.end_programs()),
        expect=Expect.TOLERATED,
        hold_s=3.0,
        reason="there is enough memory, and the service locks its own",
        touches="processor",
        burdens_host=True,
    ),
    Fault(
        name="host-interpreter-hogged",
        layer=Layer.HOST,
        how="a busy thread of pure Python runs inside the daemon",
        act=HardwareAction(
            lambda hardware: hardware.occupy_interpreter(), lambda hardware: hardware.release_interpreter()
        ),
        expect=Expect.HONEST,
        hold_s=3.0,
        reason="Python switches threads every 0.5 ms; frames may be dropped, never sent late",
        touches="processor",
        burdens_host=True,
    ),
    _wall_clock("forward", 3600.0),
    _wall_clock("back", -3600.0),
)
