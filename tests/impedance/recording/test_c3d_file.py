"""What a C3D file does to the process that reads it stays there: a crash, a hang, a memory eaten up are one line."""

import re
from pathlib import Path

import pytest

from impedance.recording import c3d_file
from impedance.recording.c3d_file import read_contents
from messages.errors import UserError
from tests.fuzz.samples import c3d_files

pytest.importorskip("ezc3d")


@pytest.mark.parametrize(
    ("child", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "reading it ended with SIGSEGV"),
        ("import time; time.sleep(60)", "reading it takes longer than 0.5 s"),
        ("import sys; sys.exit('first\\nlast words\\n')", "last words"),
        ("print('no message')", "not a C3D file"),
    ],
)
def test_whatever_ends_the_child_is_one_line(
    child: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trial.c3d"
    path.write_bytes(c3d_files()[0])
    monkeypatch.setattr(c3d_file, "_CHILD", child)
    with pytest.raises(UserError, match=re.escape(said)) as refused:
        read_contents(path, longest_s=0.5 if "sleep" in child else 30.0)
    assert "\n" not in str(refused.value)


def test_memory_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The library's part is played by a list that grows, and that the bound must stop."""
    path = tmp_path / "trial.c3d"
    path.write_bytes(c3d_files()[0])
    hungry = "import ezc3d; ezc3d.c3d = lambda path: bytearray(3 << 30); " + c3d_file._CHILD
    monkeypatch.setattr(c3d_file, "_CHILD", hungry)
    with pytest.raises(UserError, match="MemoryError"):
        read_contents(path)


def test_a_sound_file_comes_through_whole(tmp_path: Path) -> None:
    path = tmp_path / "trial.c3d"
    path.write_bytes(c3d_files()[0])
    points, analogs, platforms, events = read_contents(path)
    assert points.labels == ("P1", "P2", "P3")
    assert (points.units, points.rate_hz, points.values.shape[:2]) == (("m",), 70.0, (3, 3))
    assert (analogs.rate_hz, analogs.values.shape[:2]) == (70.0, (1, 6))
    assert (platforms.get("TYPE"), events) == (None, ())
