"""The rig's CAN bus on loopback, served for a test."""

import contextlib
import threading
from collections.abc import Iterator

from sim_rig.can.slcan_hub import SlcanHub


@contextlib.contextmanager
def served_hub(port: int = 0) -> Iterator[SlcanHub]:
    """A hub served by a thread of its own while the context lasts."""
    hub = SlcanHub(port)
    ended = threading.Event()

    def serve() -> None:
        while not ended.is_set():
            hub.serve(0.05)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield hub
    finally:
        ended.set()
        thread.join()
        hub.close()
