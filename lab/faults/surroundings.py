"""What surrounds the daemon under test: its CAN adapter, its Zenoh subscribers, its host's other programs."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from lab.faults.can_adapter import SimulatedCanAdapter

_SUBSCRIBERS = """
import json, os, signal, sys, zenoh
endpoint, key, count, asleep = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4] == "asleep"
config = {"mode": "client", "connect": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
sessions = [zenoh.open(zenoh.Config.from_json5(json.dumps(config))) for _ in range(count)]
held = [session.declare_subscriber(key, lambda sample: None) for session in sessions]
os.kill(os.getpid(), signal.SIGSTOP) if asleep else signal.pause()
"""
_BUSY = "while True: pass"
_GREEDY = """
import sys, time
held = bytearray(int(sys.argv[1]))
held[::4096] = b"x" * len(held[::4096])
time.sleep(3600)
"""


class Surroundings:
    """The daemon's process number and outlets, and the programs that faults have started."""

    def __init__(
        self, adapter: SimulatedCanAdapter, endpoint: str, everything: str, restart: Callable[[], None]
    ) -> None:
        self.adapter = adapter
        self.restart = restart
        self.daemon_pid = 0
        self._endpoint = endpoint
        self._everything = everything
        self._programs: list[subprocess.Popen[bytes]] = []

    def pause_daemon(self) -> None:
        """Stop the daemon's process as a debugger, or a full swap, would."""
        os.kill(self.daemon_pid, signal.SIGSTOP)

    def resume_daemon(self) -> None:
        """Let it go on."""
        os.kill(self.daemon_pid, signal.SIGCONT)

    def kill_daemon(self) -> None:
        """Kill the daemon's process without a word."""
        os.kill(self.daemon_pid, signal.SIGKILL)

    def start_busy_programs(self, count: int) -> None:
        """Start programs that compute without end."""
        for _ in range(count):
            self._start(_BUSY)

    def start_greedy_program(self, size_bytes: int) -> None:
        """Start a program that takes this much memory, and touches it."""
        self._start(_GREEDY, str(size_bytes))

    def start_subscribers(self, count: int, *, asleep: bool = False) -> None:
        """Start a program with `count` sessions that subscribe to all the daemon says; `asleep`: then it is stopped."""
        self._start(_SUBSCRIBERS, self._endpoint, self._everything, str(count), "asleep" if asleep else "awake")

    def end_programs(self) -> None:
        """End every program that was started."""
        for program in self._programs:
            program.kill()
            program.wait()
        self._programs.clear()

    def _start(self, code: str, *arguments: str) -> None:
        self._programs.append(
            subprocess.Popen(
                [sys.executable, "-c", code, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=Path(__file__).parents[2],
            )
        )
