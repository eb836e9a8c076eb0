"""Pages that are made from messages and DBC say what those say; how much of the bus it takes."""

import runpy

import pytest

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
