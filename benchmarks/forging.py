"""Can another user of the host pose as the service, or flood it? With what is shipped; needs root, for several users.

    python -m benchmarks.forging                      # all of it, about five minutes
    python -m benchmarks.forging --only floods

The service is `gaiteyes demo` in the directory of an installed one (/run/gaiteyes, made here as its unit makes it);
both examples listen. Adversaries (`lab.faults.forger`) are programs of another user, in the service's group (who may
connect) and outside of it. They are there before the service, while it runs, while it starts anew and afterwards. For
the floods the service has pictures rendered beforehand and its real-time priorities, as on a unit.
"""

import argparse
import itertools
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import zenoh

from drivers.zenoh.local_socket import SERVICE_DIRECTORY, subscriber_endpoint
from drivers.zenoh.session import open_client
from drivers.zenoh.settings import Credentials
from lab.faults.forger import FORGED_HEIGHT_M
from lab.faults.steady_service import READY
from messages import TOPIC_OF, GroundPlane, UserError

_HOME = Path(__file__).parents[1]
_DEVICE = "demo"
_MESSAGES = 200
_PHASE_S = 14.0  # at 20 messages a second more than `_MESSAGES`, the start of the program included
_START_S = 60.0
_SETTLED_S = 5.0
_SUBSCRIBER_S = 2.0


class User(NamedTuple):
    """One user of the host, by number; none needs an entry."""

    uid: int
    gid: int


_GROUP = 64001
_SUBSCRIBER = User(64002, _GROUP)
_ADVERSARIES = {"in the group": User(64003, _GROUP), "outside": User(65534, 65534)}


class Program:
    """A program of `user`, or of this one, whose lines are read as they come."""

    def __init__(self, *arguments: str, user: User | None = None) -> None:
        who = [] if user is None else ["setpriv", "--clear-groups", "--regid", str(user.gid), "--reuid", str(user.uid)]
        environment = {name: value for name, value in os.environ.items() if name != "XDG_RUNTIME_DIR"} | {"HOME": "/"}
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [*who, sys.executable, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=_HOME,
            env=environment,
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    def stop(self) -> None:
        """End it."""
        self.process.terminate()
        try:
            self.process.wait(20.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self._reader.join()

    def ended(self) -> int:
        """Wait for its own end; return its exit code."""
        code = self.process.wait(_START_S)
        self._reader.join()
        return code

    def heights(self) -> tuple[int, int]:
        """Return how many grounds the example told: those of the service, and those that were forged."""
        told = [float(line.split(" height ")[1].split()[0]) for line in self.lines if " height " in line]
        forged = sum(abs(height - FORGED_HEIGHT_M) < 1e-6 for height in told)
        return len(told) - forged, forged


@contextmanager
def _running(*arguments: str, user: User | None = None) -> Iterator[Program]:
    program = Program(*arguments, user=user)
    try:
        yield program
    finally:
        program.stop()


def _example(name: str, user: User | None) -> Program:
    return Program(f"examples/{name}.py", "--accept-simulated", user=user)


def _demo(*more: str) -> Program:
    """Start the demo; return once it publishes, or has ended."""
    return _started(Program("-m", "cli.main", "demo", "--scenario", "standing", "--seconds", "3600", *more), " s  ")


def _started(service: Program, ready: str) -> Program:
    end_s = time.monotonic() + _START_S
    while service.process.poll() is None and not any(ready in line for line in service.lines):
        if time.monotonic() > end_s:
            service.stop()
            raise SystemExit("the service did not start:\n" + "\n".join(service.lines))
        time.sleep(0.05)
    return service


def _forge(kind: str, user: User, seconds: float) -> Program:
    return Program("-m", "lab.faults.forger", kind, _DEVICE, str(seconds), user=user)


def forging_on_zenoh() -> None:
    """Forge by every means, from before the service starts until after it has started anew."""
    attacks = [(kind, who) for kind in ("impostor", "bytes", "library") for who in _ADVERSARIES]
    whole_s = 3 * _PHASE_S
    adversaries = {(kind, who): _forge(kind, _ADVERSARIES[who], whole_s) for kind, who in attacks}
    time.sleep(_SETTLED_S)
    before = _example("zenoh_subscriber", _SUBSCRIBER)
    code = before.ended()
    service = _demo("--can", "virtual:forging")
    listening = _example("zenoh_subscriber", _SUBSCRIBER)
    time.sleep(_PHASE_S)
    true_then, _ = listening.heights()
    service.stop()
    service = _demo("--can", "virtual:forging")
    time.sleep(_PHASE_S)
    for adversary in adversaries.values():
        adversary.ended()
    listening.stop()
    service.stop()
    true, forged = listening.heights()
    print(f"before the service: the example ends with {code}, {sum(before.heights())} grounds ({before.lines[-1]})")
    print(f"then it told {true_then} grounds of the service, {true - true_then} after its restart, and {forged} forged")
    for (kind, who), adversary in adversaries.items():
        print(f"  {kind}, {who}: {adversary.lines[-1]} messages")


def forging_on_can() -> None:
    """Forge on the simulated CAN bus: hold its port, then send on it, then take it over while the service restarts."""
    outsider = _ADVERSARIES["outside"]
    impostor = _forge("can", outsider, _PHASE_S)
    time.sleep(_SETTLED_S)
    before = _example("can_listener", None)
    code = before.ended()
    impostor.ended()
    service = _demo()
    listening = _example("can_listener", None)
    time.sleep(_SETTLED_S)
    adversary = _forge("can", outsider, 2 * _PHASE_S)
    time.sleep(_PHASE_S)
    service.stop()
    time.sleep(1.0)
    service = _demo()
    adversary.ended()
    listening.stop()
    service.stop()
    true, forged = listening.heights()
    print(
        f"CAN, before the service: the example ends with {code}, {sum(before.heights())} grounds ({before.lines[-1]})"
    )
    print(f"CAN: the example told {true} grounds of the service and {forged} forged, of {adversary.lines[-1]}")


class Heard:
    """The instants at which grounds came in, by a subscriber of its own."""

    def __init__(self) -> None:
        self._instants_s: list[float] = []
        self.asked_s = time.monotonic()
        self._session = open_client(subscriber_endpoint(_DEVICE), Credentials())
        hear: zenoh.handlers.Callback[zenoh.Sample] = zenoh.handlers.Callback(
            lambda _sample: self._instants_s.append(time.monotonic()), indirect=False
        )
        self._session.declare_subscriber(TOPIC_OF[GroundPlane].key(_DEVICE), hear)

    def first_s(self) -> float:
        """Return how long the first ground took from the wish to listen; infinite after `_SUBSCRIBER_S`."""
        end_s = self.asked_s + _SUBSCRIBER_S
        while not self._instants_s and time.monotonic() < end_s:
            time.sleep(0.005)
        return self._instants_s[0] - self.asked_s if self._instants_s else float("inf")

    def told(self) -> str:
        """Return rate and worst gap, in words, and end."""
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stubs leave it bare
        gaps_s = [after - before for before, after in itertools.pairwise(self._instants_s)]
        rate_hz = len(gaps_s) / (self._instants_s[-1] - self._instants_s[0])
        return f"{rate_hz:6.2f} planes/s, worst gap {1e3 * max(gaps_s):4.0f} ms"


def floods(seconds: float) -> None:
    """Flood the service by one kind of message after the other; what a subscriber hears meanwhile, and a new one."""
    user = _ADVERSARIES["in the group"]
    service = _started(Program("-m", "lab.faults.steady_service", "3600"), READY)
    time.sleep(_SETTLED_S)
    for kinds in ((), ("puts",), ("queries",), ("connections",), ("idle",), ("half-open",)):
        with ExitStack() as ending:
            flooding = [_forge(kind, user, seconds + _SETTLED_S) for kind in kinds]
            for program in flooding:
                ending.callback(program.stop)
            time.sleep(_SETTLED_S if kinds else 0.0)
            heard = Heard()
            first_s = heard.first_s()
            time.sleep(seconds - (time.monotonic() - heard.asked_s))
            told = heard.told()
            sent = [program.lines[-1] for program in flooding if program.ended() == 0 and program.lines]
            name = " ".join(kinds) or "nothing"
            print(
                f"{name:12} {told}, a new subscriber's first {first_s:5.2f} s; sent {' '.join(sent) or '0'}", flush=True
            )
    service.stop()


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("zenoh", "can", "floods"))
    parser.add_argument("--seconds", type=float, default=20.0, help="of each flood")
    options = parser.parse_args(arguments)
    if os.geteuid() != 0:
        parser.error("needs root: it starts programs of several users")
    try:
        SERVICE_DIRECTORY.mkdir(mode=0o750)
    except FileExistsError:
        parser.error(f"{SERVICE_DIRECTORY} is there: a service is installed on this host")
    try:
        os.chown(SERVICE_DIRECTORY, 0, _GROUP)
        print(f"load of the host: {os.getloadavg()[0]:.1f}")
        if options.only in (None, "zenoh"):
            forging_on_zenoh()
        if options.only in (None, "can"):
            forging_on_can()
        if options.only in (None, "floods"):
            floods(options.seconds)
    except UserError as error:
        raise SystemExit(str(error)) from error
    finally:
        shutil.rmtree(SERVICE_DIRECTORY)


if __name__ == "__main__":
    main()
