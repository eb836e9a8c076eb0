import itertools
import time

from drivers.utc import read_utc_offset_ns


def test_the_reading_that_took_least_counts() -> None:
    took_ns = itertools.cycle([5000, 40, 700])
    now_ns = [1_000_000]
    each = [0]

    def monotonic_ns() -> int:
        return now_ns[0]

    def utc_ns() -> int:
        each[0] = next(took_ns)
        now_ns[0] += each[0]  # the clock is read at the end of a slow call
        return now_ns[0] + 10**18

    assert read_utc_offset_ns(monotonic_ns, utc_ns) == 10**18 + 20


def test_it_is_what_the_system_says() -> None:
    before_ns = time.time_ns() - time.monotonic_ns()
    assert abs(read_utc_offset_ns() - before_ns) < 10**9
