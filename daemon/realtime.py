"""What keeps the threads punctual where the host grants it: priorities, memory that stays, an unhurried interpreter.

Sources: sched(7) and mlockall(2) of the Linux manual; limits RTPRIO and MEMLOCK grant them to an ordinary user.
"""

import contextlib
import ctypes
import gc
import logging
import os
import resource
import sys
import threading
from collections.abc import Iterator

import cv2

log = logging.getLogger("gaiteyes")

FIFO_PRIORITIES = {
    "imu": 30,
    "timer": 25,
    "can": 20,
    "ankle": 20,
    "camera": 15,
    "pipeline": 10,
    "path": 10,
    "main": 5,
}
"""SCHED_FIFO by thread: a sample that is late is worse than a plane. The recorder and Zenoh's threads stay ordinary.

Matching has a priority too, the lowest that counts: the interpreter's lock knows no priority inheritance, and an IMU
thread waits for as long as other processes keep an ordinary thread that holds the lock off the processor.
"""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def request_priorities() -> bool:
    """Return whether the host grants `set_priority`; a refusal is said in one line and does no harm."""
    try:
        _schedule(max(FIFO_PRIORITIES.values()))
    except OSError as error:
        log.warning("no real-time priorities: %s; LimitRTPRIO= of the unit grants them", error.strerror)
        return False
    set_priority("main")
    return True


def set_priority(thread: str) -> None:
    """Give the calling thread the priority of its name, if it has one. Raises OSError if the host refuses."""
    if thread in FIFO_PRIORITIES:
        _schedule(FIFO_PRIORITIES[thread])


def give_way() -> None:
    """Let the calling thread, one without a real-time priority, leave the processor to others sooner (nice of 5)."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 5)


def reset_priority() -> None:
    """Give the calling thread's priority back."""
    # an ordinary user may not take SCHED_RESET_ON_FORK back
    os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def _schedule(priority: int) -> None:
    # threads that a library starts from this one are not to inherit its priority
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def lock_memory() -> None:
    """Keep what this process touches in memory; a refusal is said and does no harm.

    Pages are locked as they are first used (MCL_ONFAULT): locking all that is mapped, the stacks of all threads above
    all, would take seven times the memory.
    """
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft != resource.RLIM_INFINITY and os.geteuid() != 0:
        # under a limit a later allocation would fail, where now it is only this request
        log.warning("memory is not locked: the limit is %d MB; LimitMEMLOCK=infinity of the unit lifts it", soft >> 20)
        return
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        log.warning("memory is not locked: %s; LimitMEMLOCK= grants it", os.strerror(ctypes.get_errno()))


@contextlib.contextmanager
def paced_interpreter() -> Iterator[None]:
    """Set what keeps the threads punctual: one OpenCV thread, a short switch interval, no collector pauses."""
    threads, interval = cv2.getNumThreads(), sys.getswitchinterval()
    cv2.setNumThreads(1)
    sys.setswitchinterval(5e-4)
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(interval)
        cv2.setNumThreads(threads)
