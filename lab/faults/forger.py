"""Programs of an adversary on the same host, each for as long as asked: they forge the ground, or flood the service.

    python -m lab.faults.forger KIND DEVICE SECONDS [DIRECTORY]

What is forged would pass every check of a receiver: the right device, boot and source, fresh, numbered far ahead, the
height `FORGED_HEIGHT_M`. Each prints how many messages, or connections, it sent.
"""

import contextlib
import json
import resource
import socket
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import zenoh

from drivers.boot_id import read_boot_id
from drivers.zenoh.local_socket import SERVICE_DIRECTORY
from drivers.zenoh.settings import SOCKET
from lab.faults.zenoh_bytes import ZenohBytes
from messages import TOPIC_OF, GroundPlane, Reason, Source, Stamp, Status
from messages.can_encoder import CanEncoder
from messages.codec import encode_line
from sim_rig.can.slcan_hub import PORT

FORGED_HEIGHT_M = 0.123
CONNECTIONS = 500
_PERIOD_S = 0.05
_AGE_NS = 30_000_000
_OLD_TCP_PORT = 7447
_AHEAD = 1_000_000
_PUTS_IN_A_FRAME = 10


class Task:
    """What a program does it to: the service of `device`, whose socket lies in `directory`, until `end_s`."""

    def __init__(self, device: str, seconds: float, directory: Path) -> None:
        self.device = device
        self.directory = directory
        self.socket = directory / f"{device}.sock"
        self.key = TOPIC_OF[GroundPlane].key(device)
        self.sent = 0
        self._end_s = time.monotonic() + seconds

    @property
    def goes_on(self) -> bool:
        """Return whether the time is not up."""
        return time.monotonic() < self._end_s

    def ground(self) -> tuple[GroundPlane, Stamp]:
        """Return the next forged ground, published now."""
        now_ns = time.monotonic_ns()
        ground = GroundPlane(
            t_exposure_ns=now_ns - _AGE_NS,
            frame_seq=_AHEAD + self.sent,
            status=Status.VALID,
            reason=Reason.NONE,
            slope_sagittal_rad=0.3,
            slope_frontal_rad=0.0,
            height_m=FORGED_HEIGHT_M,
            covariance=(1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-6),
            ahead_m=0.7,
            matched_share=0.9,
            inlier_share=0.9,
            disparity_noise_px=0.1,
            calibration_id="a3f01234",
        )
        stamp = Stamp(
            device=self.device,
            boot_id=read_boot_id(),
            source=Source.LIVE,
            seq=_AHEAD + self.sent,
            t_publish_ns=now_ns,
            age_s=1e-9 * _AGE_NS,
        )
        self.sent += 1
        return ground, stamp

    def line(self) -> bytes:
        """Return it as it would stand on Zenoh."""
        return encode_line(TOPIC_OF[GroundPlane], *self.ground())


def forge_by_bytes(task: Task) -> None:
    """Connect to the service, again and again if need be, and publish whatever access control says."""
    while task.goes_on:
        with contextlib.suppress(OSError), contextlib.closing(ZenohBytes(task.socket)) as connection:
            while task.goes_on:
                connection.put(task.key, task.line())
                time.sleep(_PERIOD_S)
        time.sleep(_PERIOD_S)


def forge_by_library(task: Task) -> None:
    """Connect to the service as a client, publish its topics, answer its queries, show its presence."""
    while task.goes_on:
        try:
            session = _session(mode="client", connect=[f"{SOCKET}{task.socket}"])
        except zenoh.ZError:
            time.sleep(_PERIOD_S)
            continue
        _pose(task, session)


def pose_as_the_service(task: Task) -> None:
    """Be where subscribers look, before the service starts and while it starts anew.

    Makes the directory or takes the socket's place in it, listens on the port that was the standard one, answers those
    that look for anybody, and holds the port of the simulated CAN bus. Each is tried over and over.
    """
    while task.goes_on:
        listening = [f"tcp/0.0.0.0:{_OLD_TCP_PORT}"]
        with contextlib.suppress(OSError):
            task.directory.mkdir(mode=0o755, exist_ok=True)
            task.socket.unlink(missing_ok=True)
            socket.socket(socket.AF_UNIX).bind(str(task.socket))
            task.socket.unlink()
            listening.append(f"{SOCKET}{task.socket}")
        try:
            session = _session(mode="peer", listen=listening, multicast=True)
        except zenoh.ZError:  # another impostor has the port
            session = _session(mode="peer", listen=["tcp/127.0.0.1:0"], multicast=True)
        _pose(task, session)


def forge_on_can(task: Task) -> None:
    """Send on the simulated CAN bus: as a client of it, and as the bus itself where its port is free."""
    encoder = CanEncoder()
    server: socket.socket | None = None
    bus: list[socket.socket] = []
    while task.goes_on:
        if server is None:
            with contextlib.suppress(OSError):
                server = socket.create_server(("127.0.0.1", PORT))
                server.setblocking(False)
        with contextlib.suppress(OSError):
            if server is not None:
                bus.append(server.accept()[0])
            elif not bus:
                bus.append(socket.create_connection(("127.0.0.1", PORT), timeout=1.0))
        ground, stamp = task.ground()
        frames = encoder.ground(ground, stamp, stamp.age_s)
        line = "".join(f"t{frame.can_id:03X}{len(frame.data)}{frame.data.hex().upper()}\r" for frame in frames).encode()
        bus = [each for each in bus if _took(each, line)]
        time.sleep(_PERIOD_S)


def _took(connection: socket.socket, data: bytes) -> bool:
    try:
        connection.sendall(data)
    except OSError:
        connection.close()
        return False
    return True


def flood_puts(task: Task) -> None:
    """Publish as fast as the socket takes it."""
    while task.goes_on:
        with contextlib.suppress(OSError), contextlib.closing(ZenohBytes(task.socket)) as connection:
            line = task.line()
            while task.goes_on:
                connection.put(task.key, line, times=_PUTS_IN_A_FRAME)
                task.sent += _PUTS_IN_A_FRAME


def flood_queries(task: Task) -> None:
    """Ask for the schema as fast as the library can."""
    session = _session(mode="client", connect=[f"{SOCKET}{task.socket}"])
    ignore: zenoh.handlers.Callback[zenoh.Reply] = zenoh.handlers.Callback(lambda _reply: None, indirect=False)
    while task.goes_on:
        session.get(f"gaiteyes/{task.device}/schema", ignore, timeout=0.2)
        task.sent += 1
    session.close()  # type: ignore[no-untyped-call]  # zenoh's stubs leave it bare


def flood_connections(task: Task) -> None:
    """Connect and hang up, as fast as the system can."""
    while task.goes_on:
        with contextlib.suppress(OSError):
            ZenohBytes(task.socket, greeting=False).close()
            task.sent += 1


def hold_idle(task: Task) -> None:
    """Keep `CONNECTIONS` sessions that are open and say nothing more."""
    _hold(task, lambda: ZenohBytes(task.socket, lease_s=100))


def hold_half_open(task: Task) -> None:
    """Keep `CONNECTIONS` connections in the middle of their greeting; those hung up on are made anew at once."""

    def half() -> ZenohBytes:
        connection = ZenohBytes(task.socket, greeting=False)
        connection.send_half_a_greeting()
        return connection

    _hold(task, half)


def _hold(task: Task, opened: Callable[[], ZenohBytes]) -> None:
    held: list[ZenohBytes] = []
    while task.goes_on:
        held = [connection for connection in held if not _hung_up(connection)]
        with contextlib.suppress(OSError):
            while len(held) < CONNECTIONS and task.goes_on:
                held.append(opened())
                task.sent += 1
        time.sleep(_PERIOD_S)


def _hung_up(connection: ZenohBytes) -> bool:
    connection.socket.setblocking(False)
    try:
        while data := connection.socket.recv(65536):
            del data
    except BlockingIOError:
        return False
    except OSError:
        pass
    connection.close()
    return True


def _session(
    *, mode: str, connect: Sequence[str] = (), listen: Sequence[str] = (), multicast: bool = False
) -> zenoh.Session:
    config = zenoh.Config()
    entries: dict[str, object] = {
        "mode": mode,
        "connect/endpoints": connect,
        "listen/endpoints": listen,
        "scouting/multicast/enabled": multicast,
        "transport/shared_memory/enabled": False,
    }
    for name, value in entries.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


def _pose(task: Task, session: zenoh.Session) -> None:
    """Publish, answer and be present in the service's name until the time is up."""
    schema = f"gaiteyes/{task.device}/schema"
    held = (
        session.declare_queryable(schema, lambda query: query.reply(schema, b"forged")),
        session.liveliness().declare_token(f"gaiteyes/{task.device}/alive"),
    )
    while task.goes_on:
        session.put(task.key, task.line())
        time.sleep(_PERIOD_S)
    for each in held:
        each.undeclare()  # type: ignore[no-untyped-call]
    session.close()  # type: ignore[no-untyped-call]


KINDS: dict[str, Callable[[Task], None]] = {
    "bytes": forge_by_bytes,
    "library": forge_by_library,
    "impostor": pose_as_the_service,
    "can": forge_on_can,
    "puts": flood_puts,
    "queries": flood_queries,
    "connections": flood_connections,
    "idle": hold_idle,
    "half-open": hold_half_open,
}


def main() -> None:
    """Do what the arguments say."""
    kind, device, seconds, *directory = sys.argv[1:]
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    task = Task(device, float(seconds), Path(*directory) if directory else SERVICE_DIRECTORY)
    KINDS[kind](task)
    print(task.sent, flush=True)


if __name__ == "__main__":
    main()
