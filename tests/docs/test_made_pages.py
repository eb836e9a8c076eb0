"""Pages that are made from messages and DBC say what those say; how much of the bus it takes."""

import runpy
from pathlib import Path

import cv2
import pytest

from tests.bench.browser import chromium
from tests.bench.narrow_page import NARROW_PX
from tests.docs.pages import ROOT


@pytest.mark.parametrize("name", ["can", "zenoh"])
def test_the_page_is_up_to_date(name: str) -> None:
    maker = runpy.run_path(str(ROOT / "docs" / f"make_{name}.py"))
    mend = f"python docs/make_{name}.py"
    assert (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") == maker["page"](), mend


def test_a_frame_of_eight_bytes_is_135_bits_at_worst() -> None:
    """As schedulability analyses of CAN count it: 55 + 10 n bits."""
    page = (ROOT / "docs" / "can.md").read_text(encoding="utf-8")
    assert "| GROUND | 0x1A0 | 20 | 135 | 0.54 % |" in page


@pytest.mark.long
def test_the_picture_of_a_report_can_be_made_anew(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    program = chromium()
    if program is None:
        pytest.skip("no Chromium on this machine")
    maker = runpy.run_path(str(ROOT / "docs" / "make_report_picture.py"))
    maker["make"](tmp_path / "report.png", program)
    made, kept = (
        cv2.imread(str(path)) for path in (tmp_path / "report.png", ROOT / "docs" / "pictures" / "report.png")
    )
    assert made is not None
    assert kept is not None
    assert made.shape == kept.shape == (maker["HEIGHT_PX"], NARROW_PX, 3)
    assert float(made.std()) > 20.0  # it is not empty
