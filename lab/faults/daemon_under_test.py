"""The daemon under test, with one walking wearer, the faults around it, and what it sends.

campaign ── orders ──► daemon's process: simulated hardware (chip, camera node) ─ drivers ─ service
  ▲  ▲                                                                                       │
  │  └──────────────────────────────── Zenoh, loopback ──────────────────────────────────────┤
  └────── CAN, slcan over a pseudo-terminal ─────────────────────────────────────────────────┘
"""

import time
from collections import Counter
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drivers.zenoh.settings import SOCKET
from lab.evaluation.busy_host import Burden, ProcessorPressure
from lab.faults.can_adapter import SimulatedCanAdapter
from lab.faults.catalogue import carry_out
from lab.faults.criteria import Wrong
from lab.faults.daemon_process import DEVICE, DaemonPlan, DaemonProcess, Order, open_files, resident_mb, threads
from lab.faults.fault import Fault, HardwareAction, OutsideAction
from lab.faults.listener import Listener
from lab.faults.report import FaultFree, Process
from lab.faults.surroundings import Surroundings
from lab.faults.trial import is_steady
from messages import INTERFACE_VERSION, TOPICS, UserError
from sim_rig.camera.film import Film
from sim_rig.walk.scenario import repeating, scenario
from sim_rig.wearer import SimulatedWearer

SCENARIO = "ramps"
_LEAD_S = 6.0  # before the wearer's clock starts: by then the first daemon runs
_SERVE_S = 0.003  # for one look at the bus, far below what makes a message late
_STEADY_FRAMES = 20  # a second of right grounds, and of right attitudes, is steady
_STEADY_ATTITUDES = 100
_WALK_AHEAD_S = 5.0  # of walking that must lie ahead of a fault that needs motion
_GRID_S = 0.05  # steps in which walking and standing are told apart


def film_of_lap(seed: int, path: Path) -> Film:
    """Render a lap of the wearer's walk into the file at `path`; takes half a minute on two slow cores."""
    walk = repeating(scenario(SCENARIO))
    wearer = SimulatedWearer(seed, walk, 0)
    return wearer.film(wearer.gait.lap_s, path)


class Mark(NamedTuple):
    """An instant from which on it is judged what the host does to the test."""

    t_s: float
    pressure: ProcessorPressure
    rig_late: int
    heard: int
    held_up: int


class DaemonUnderTest:
    """Keeps the daemon running in `folder`, an empty one, and hears it. Close it when done.

    A start may take `patience_s` to a steady ground; a machine that is busy with other things needs more. The wearer's
    walk is the `film` that `film_of_lap` made for this seed, or rendered as it goes.
    """

    def __init__(self, seed: int, folder: Path, *, patience_s: float = 15.0, film: Film | None = None) -> None:
        self._patience_s = patience_s
        self.adapter = SimulatedCanAdapter(folder / "can-adapter")
        self.plan = DaemonPlan(
            seed=seed,
            scenario=SCENARIO,
            start_ns=time.monotonic_ns() + round(_LEAD_S * 1e9),
            zenoh=f"{SOCKET}{folder / 'zenoh.sock'}",
            can=self.adapter.settings,
            log=folder / "daemon.log",
            film=film,
        )
        self.free = FaultFree()
        self.longest: Process | None = None
        self.starts = self.hung_stops = 0
        self._wearer = self.plan.wearer()
        self.listener = Listener(self._wearer)
        self.around = Surroundings(
            self.adapter, self.plan.zenoh, f"gaiteyes/{DEVICE}/*/v{INTERFACE_VERSION}", lambda: self.start(self.plan)
        )
        self._daemon: DaemonProcess | None = None
        self._first_look: Process | None = None
        self._looked_s = 0.0
        self._free_from_ns: int | None = None
        self._free_mark: Mark | None = None
        self._wrong_then = Wrong()

    # The daemon

    def start(self, plan: DaemonPlan) -> None:
        """Start the daemon, in place of the one that runs. Raises UserError if it refuses."""
        self.stop()
        self._daemon = DaemonProcess(plan, carry_out)
        self.around.daemon_pid = self._daemon.pid
        self.listener.connect(plan.zenoh)
        self.starts += 1

    def stop(self) -> None:
        """End the daemon, if one runs."""
        self.listener.close()
        daemon, self._daemon = self._daemon, None
        self._first_look = self._free_from_ns = self._free_mark = None
        if daemon is not None and not daemon.stop():
            self.hung_stops += 1
        self.adapter.discard()

    def close(self) -> None:
        """End everything that runs."""
        self.around.end_programs()
        self.stop()
        self.adapter.unplug()

    def rig_late(self) -> int:
        """Return how many frames the rig itself failed to render in time since the daemon's start."""
        return self._running().order(None).rig_late

    def mark(self) -> Mark:
        """Begin to judge what the host does to the test."""
        heard = self.listener
        return Mark(time.monotonic(), ProcessorPressure(), self.rig_late(), heard.heard, heard.held_up)

    def burden(self, since: Mark) -> Burden:
        """Return what the host has done to the test since then; a new start of the daemon begins its count anew."""
        return Burden(
            waiting=since.pressure.share(),
            frames=round((time.monotonic() - since.t_s) * TOPICS["ground"].rate_hz),
            frames_late=max(0, self.rig_late() - since.rig_late),
            heard=self.listener.heard - since.heard,
            held_up=self.listener.held_up - since.held_up,
        )

    @property
    def wrong(self) -> Wrong:
        """Return all that was ever wrong and marked valid, but for fault-free time that goes on."""
        return self.listener.wrong if self._free_from_ns is None else self._wrong_then

    # Faults

    def inject(self, fault: Fault) -> None:
        """Let the fault begin."""
        self._act(fault, inject=True)

    def clear(self, fault: Fault) -> None:
        """Take its cause away."""
        self._act(fault, inject=False)

    def _act(self, fault: Fault, *, inject: bool) -> None:
        if isinstance(fault.act, OutsideAction):
            (fault.act.inject if inject else fault.act.clear)(self.around)
        elif isinstance(fault.act, HardwareAction):
            self._running().order(Order(fault.name, inject))
        else:
            raise TypeError(f"{fault.name} does not come and go while the daemon runs")

    def _running(self) -> DaemonProcess:
        if self._daemon is None:
            raise UserError("no daemon is under test")
        return self._daemon

    # Listening

    def listen(self, timeout_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Serve the bus and hear the outlets for `timeout_s`, or until `until`; return whether that came."""
        end_s = time.monotonic() + timeout_s
        while not (reached := until()) and time.monotonic() < end_s:
            for frame in self.adapter.serve(_SERVE_S):
                self.listener.hear_can(frame)
            self.listener.take()
        return reached

    def settle(self, *, in_motion: bool) -> bool:
        """Listen until the ground is steadily valid, in the middle of a walk if `in_motion`.

        A daemon that does not come to that is started anew. Return whether it came to it.
        """
        if self._daemon is None or not self._daemon.alive:
            self.start(self.plan)
        if not self.await_steady():
            self.start(self.plan)
            if not self.await_steady():
                return False
        if in_motion:
            self.listen(self._patience_s, lambda: self._walks_on() and self._is_steady(0))
        self.look()
        return True

    def await_steady(self) -> bool:
        """Listen until the ground is steadily valid; return whether it came to that."""
        since_ns = self._free_from_ns or time.monotonic_ns()
        return self.listen(self._patience_s, lambda: self._is_steady(since_ns))

    def counted(self) -> Counter[str]:
        """Return the daemon's own counters as last heard."""
        return self.listener.counted()

    def walked_s(self, from_ns: int, to_ns: int) -> float:
        """Return how long the wearer walked between two instants."""
        grid_ns = np.arange(from_ns, to_ns, round(_GRID_S * 1e9))
        if len(grid_ns) == 0:
            return 0.0
        return float((~self._wearer.gait.at(grid_ns).standing).mean()) * 1e-9 * (to_ns - from_ns)

    def _is_steady(self, since_ns: int) -> bool:
        right = not any(a.wrong for a in islice(reversed(self.listener.attitudes), _STEADY_ATTITUDES))
        return right and is_steady(self.listener.grounds, since_ns, _STEADY_FRAMES, time.monotonic_ns())

    def _walks_on(self) -> bool:
        now_ns = time.monotonic_ns()
        return self.walked_s(now_ns, now_ns + round(_WALK_AHEAD_S * 1e9)) > _WALK_AHEAD_S - _GRID_S

    # Fault-free time and the process

    def begin_free(self) -> None:
        """Count what is heard from now on as fault-free."""
        self._free_from_ns, self._free_mark, self._wrong_then = time.monotonic_ns(), self.mark(), self.listener.wrong

    def end_free(self) -> None:
        """End the fault-free time; one that the host disturbed, or in which the rig lost frames, proves nothing."""
        t_ns = time.monotonic_ns()
        from_ns, self._free_from_ns = self._free_from_ns, None
        mark, self._free_mark = self._free_mark, None
        if from_ns is None or mark is None:
            return
        burden = self.burden(mark)
        if burden.frames_late or burden.too_much:
            self.free.left_out_s += 1e-9 * (t_ns - from_ns)
            return
        heard = [h for h in self.listener.grounds if from_ns < h.t_ns <= t_ns]
        away = [h for h in heard if not h.truth.transition]
        self.free.add(
            FaultFree(
                seconds=1e-9 * (t_ns - from_ns),
                frames=len(heard),
                valid=sum(h.valid for h in heard),
                away=len(away),
                away_valid=sum(h.valid for h in away),
                wrong=sum(h.errors.wrong for h in heard),
                wrong_on_can=sum(c.errors.wrong for c in self.listener.on_can if from_ns < c.t_ns <= t_ns),
                stale=sum(h.stale for h in heard),
                wrong_attitudes=sum(a.wrong for a in self.listener.attitudes if from_ns < a.t_ns <= t_ns),
            )
        )

    def look(self) -> Process:
        """Return how large the process is, beside the first look; of all processes the longest-lived one is told."""
        pid, now_s = self._running().pid, time.monotonic()
        mb, running, files = resident_mb(pid), threads(pid), open_files(pid)
        now = Process(seconds=0.0, memory_mb=(mb, mb), threads=(running, running), open_files=(files, files))
        if self._first_look is None:
            self._first_look, self._looked_s = now, now_s
        lived = now.since(self._first_look, now_s - self._looked_s)
        if self.longest is None or lived.seconds >= self.longest.seconds:
            self.longest = lived
        return lived
