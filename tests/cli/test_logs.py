"""The journal gets a priority on every line, a person gets the words."""

import os
import subprocess
import sys
from pathlib import Path

SPEAKING = """
import logging, threading
from cli.logs import configure_logs
configure_logs()
log = logging.getLogger("gaiteyes")
log.error("camera lost: %s", "gone")
log.warning("camera is back")
def bug(): raise ZeroDivisionError("a bug")
thread = threading.Thread(target=bug, name="gaiteyes-imu"); thread.start(); thread.join()
"""


def spoken(path: Path, journal: bool) -> list[str]:
    with path.open("wb") as stderr:
        told = os.fstat(stderr.fileno())
        stream = f"{told.st_dev}:{told.st_ino}" if journal else "1:1"
        environment = os.environ | {"JOURNAL_STREAM": stream}
        subprocess.run([sys.executable, "-c", SPEAKING], stderr=stderr, env=environment, timeout=60, check=True)
    return path.read_text(encoding="utf-8").splitlines()


def test_in_the_journal_each_line_has_its_priority_tracebacks_too(tmp_path: Path) -> None:
    lines = spoken(tmp_path / "err", journal=True)
    assert lines[:4] == [
        "<3>camera lost: gone",
        "<4>camera is back",
        "<2>thread gaiteyes-imu died",
        "<2>Traceback (most recent call last):",
    ]
    assert lines[-1] == "<2>ZeroDivisionError: a bug"
    assert all(line.startswith("<2>") for line in lines[2:])


def test_a_person_reads_words_even_if_another_stream_is_the_journals(tmp_path: Path) -> None:
    assert spoken(tmp_path / "err", journal=False)[:2] == ["gaiteyes: camera lost: gone", "gaiteyes: camera is back"]
