"""Priorities and locked memory where the host grants them, one line where it does not."""

import logging
import os
import resource
import subprocess
import sys
import threading

import pytest

from daemon import realtime

OF_ITS_OWN = """
import logging, os, resource, sys
from daemon import realtime
logging.basicConfig(format="%(message)s")
try:
    resource.setrlimit(resource.RLIMIT_MEMLOCK, ({memory}, {memory}))
    resource.setrlimit(resource.RLIMIT_RTPRIO, ({priority}, {priority}))
except ValueError:
    sys.exit("limits cannot be raised here")
os.setuid(65534)
realtime.lock_memory()
print(realtime.request_priorities())
"""


def as_nobody(memory: str, priority: int) -> subprocess.CompletedProcess[str]:
    """Run `lock_memory` and `request_priorities` in a process without privileges, under these limits."""
    if os.geteuid() != 0:
        pytest.skip("giving privileges up needs root")
    code = OF_ITS_OWN.format(memory=memory, priority=priority)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    if "limits cannot be raised" in done.stderr:
        pytest.skip("this host lets nobody raise limits")
    assert done.returncode == 0, done.stderr
    return done


def test_a_refusal_is_one_line_each_and_does_no_harm() -> None:
    done = as_nobody(memory=str(1 << 23), priority=0)
    assert done.stdout == "False\n"
    assert done.stderr.splitlines() == [
        "memory is not locked: the limit is 8 MB; LimitMEMLOCK=infinity of the unit lifts it",
        "no real-time priorities: Operation not permitted; LimitRTPRIO= of the unit grants them",
    ]


def test_the_limits_of_the_unit_suffice_without_privileges() -> None:
    done = as_nobody(memory="resource.RLIM_INFINITY", priority=50)
    assert (done.stdout, done.stderr) == ("True\n", "")


def test_the_imu_goes_before_can_and_all_who_take_the_interpreters_lock_before_other_processes() -> None:
    priority = realtime.FIFO_PRIORITIES
    assert priority["imu"] > priority["timer"] > priority["can"] > priority["camera"] > priority["pipeline"] > 0
    assert "recorder" not in priority


def test_a_thread_gets_the_priority_of_its_name_and_its_children_do_not() -> None:
    if resource.getrlimit(resource.RLIMIT_RTPRIO)[0] == 0 and os.geteuid() != 0:
        pytest.skip("this host grants no real-time priorities")
    seen: dict[str, tuple[int, int]] = {}

    def look(name: str) -> None:
        seen[name] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority

    def prioritised(name: str) -> None:
        realtime.set_priority(name)
        look(name)
        if name == "imu":
            child = threading.Thread(target=look, args=("child",))
            child.start()
            child.join()

    for name in ("imu", "recorder"):
        thread = threading.Thread(target=prioritised, args=(name,))
        thread.start()
        thread.join()
    assert seen == {
        "imu": (os.SCHED_FIFO, realtime.FIFO_PRIORITIES["imu"]),
        "child": (os.SCHED_OTHER, 0),
        "recorder": (os.SCHED_OTHER, 0),
    }


def test_the_main_threads_priority_is_given_back(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "gaiteyes"):
        granted = realtime.request_priorities()
    if granted:
        assert os.sched_getscheduler(0) & os.SCHED_FIFO
        realtime.reset_priority()
    assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
    assert len(caplog.records) == (not granted)
