"""Pages that are made from messages and DBC say what those say; how much of the bus it takes."""

import subprocess
import sys

import pytest

from tests.docs.pages import ROOT


@pytest.mark.parametrize("maker", ["make_can.py", "make_zenoh.py", "make_api.py"])
def test_the_page_is_up_to_date(maker: str) -> None:
    command = [sys.executable, f"docs/{maker}", "--check"]
    done = subprocess.run(command, cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_frame_of_eight_bytes_is_135_bits_at_worst() -> None:
    """As schedulability analyses of CAN count it: 55 + 10 n bits."""
    page = (ROOT / "docs" / "can.md").read_text(encoding="utf-8")
    assert "| GROUND | 0x1A0 | 20 | 135 | 0.54 % |" in page
