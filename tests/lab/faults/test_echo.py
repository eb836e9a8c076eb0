"""A process hears its own echo promptly, but not after it has been stopped for a while."""

import os
import signal
import subprocess
import sys
import time

CHILD = """
import os, signal, time
from lab.faults.echo import Echo

def becomes_prompt():
    until = time.monotonic() + 30.0
    while time.monotonic() < until:
        if echo.is_prompt(time.monotonic_ns()):
            return True
        time.sleep(0.01)
    return False

echo = Echo()
print(becomes_prompt(), flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
print(echo.is_prompt(time.monotonic_ns()), flush=True)
print(becomes_prompt(), flush=True)
echo.close()
"""


def test_an_echo_tells_of_a_process_that_was_held_up() -> None:
    with subprocess.Popen([sys.executable, "-c", CHILD], stdout=subprocess.PIPE, text=True) as child:
        os.waitpid(child.pid, os.WUNTRACED)  # its first answer waits in the pipe
        time.sleep(0.3)
        child.send_signal(signal.SIGCONT)
        told, _ = child.communicate(timeout=60.0)
    assert told.split() == ["True", "False", "True"]
