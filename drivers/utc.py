"""How the clock of all messages (CLOCK_MONOTONIC) stands to UTC."""

import time
from collections.abc import Callable

READINGS = 16


def read_utc_offset_ns(
    monotonic_ns: Callable[[], int] = time.monotonic_ns, utc_ns: Callable[[], int] = time.time_ns
) -> int:
    """Return UTC, in ns since 1970, less CLOCK_MONOTONIC; of several readings the one that took the least time.

    Both clocks are slewed alike by NTP, so that the offset holds until the system's time is set anew (see
    clock_gettime(2)).
    """
    least_ns, offset_ns = None, 0
    for _ in range(READINGS):
        before_ns = monotonic_ns()
        now_ns = utc_ns()
        took_ns = monotonic_ns() - before_ns
        if least_ns is None or took_ns < least_ns:
            least_ns, offset_ns = took_ns, now_ns - (before_ns + took_ns // 2)
    return offset_ns
