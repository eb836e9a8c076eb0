"""Every report has one frame: legible on a telephone, by itself, and telling where it comes from."""

import hashlib
import re
import sys
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from discrepancy.report.output import write_report
from messages.errors import UserError
from reports.content import Section, Table
from reports.drawing import WIDTH_IN, drawing
from reports.page import write_sections
from reports.provenance import provenance
from tests.bench.browser import chromium
from tests.bench.explained import explanation, toy
from tests.bench.html_page import read
from tests.bench.narrow_page import NARROW_PX, measured

if TYPE_CHECKING:
    from matplotlib.axes import Axes

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

MARGIN_PX = 40
"""What the margins of a telephone's page take."""
SMALLEST_LETTER_PX = 11.0
POINTS_PER_INCH = 72.0
WIDE_COLUMNS = 4
"""From so many on a table does not fit a telephone side by side."""

SHEET = Table("a < b", ("what", "x", "y", "z"), (("first & only", "1", "2", "3"),), "in metres")


def line(title: str) -> str:
    return drawing(title, lambda axes: axes.plot([0.0, 1.0], [0.0, 1.0]))


@pytest.fixture(scope="module")
def sections(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sections") / "page.html"
    both = (Section("Part", ("A sentence.",), SHEET, (line("up"), line("again"))),)
    write_sections(path, "Title", "Headline", both, [], lead="The lead.")
    return path


@pytest.fixture(scope="module")
def explained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("explained")
    write_report(explanation(toy(1)), folder)
    return folder / "report.html"


@pytest.fixture(params=["sections", "explained"])
def page(request: pytest.FixtureRequest) -> str:
    path: Path = request.getfixturevalue(request.param)
    read(path)  # well formed, nothing from elsewhere
    return path.read_text(encoding="utf-8")


def test_a_telephone_shows_it_at_its_own_width(page: str) -> None:
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    assert not re.search(r"url\((?!#)|@import|https?://(?!www\.w3\.org/)", page)


def test_a_wide_table_names_each_number_where_it_stands_as_a_block(page: str) -> None:
    tables = re.findall(r"<table.*?</table>", page, re.DOTALL)
    wide = [table for table in tables if len(re.findall(r"<th\b", table)) >= WIDE_COLUMNS]
    assert wide
    for table in wide:
        assert table.startswith('<table class="wide">')
        cells = re.findall(r"<td([^>]*)>", table)
        assert all("data-column=" in cell or 'class="bars"' in cell for cell in cells)


def test_letters_of_a_drawing_stay_legible(page: str) -> None:
    drawings = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert drawings
    for svg in drawings:
        width_pt = float(re.search(r'viewBox="0 0 ([\d.]+) ', svg).group(1))  # type: ignore[union-attr]  # None fails
        assert width_pt <= POINTS_PER_INCH * WIDTH_IN + 0.1
        sizes_pt = [float(size) for size in re.findall(r"font(?:-size)?: (?:\w+ )*([\d.]+)px", svg)]
        assert sizes_pt
        assert min(sizes_pt) * (NARROW_PX - MARGIN_PX) / width_pt >= SMALLEST_LETTER_PX


def test_two_drawings_of_one_page_share_no_name(page: str) -> None:
    names = re.findall(r'<(?:clipPath|path|g|use) id="((?:m|p)[0-9a-f]{10})"', page)
    assert names
    assert len(names) == len(set(names))


def test_text_is_escaped_and_told_once(sections: Path) -> None:
    text = read(sections)
    for told in ("Title", "Headline", "The lead.", "A sentence.", "a < b", "first & only", "in metres"):
        assert told in text, told
    assert "a &lt; b" in sections.read_text(encoding="utf-8")


def test_it_says_which_files_what_version_which_command_and_when(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a recording"
    folder.mkdir()
    (folder / "imu.csv").write_bytes(b"t_s\n")
    monkeypatch.setattr(sys, "argv", ["/usr/bin/gaiteyes", "explain", "imu", str(folder), "--out", "x"])
    before = datetime.now().astimezone().replace(microsecond=0)
    write_sections(tmp_path / "page.html", "Title", "Headline", (), [folder])
    text = read(tmp_path / "page.html")
    assert f"gaiteyes explain imu '{folder}' --out x" in text
    assert hashlib.sha256(b"t_s\n").hexdigest() in text
    assert re.search(r"gaiteyes \d+\.\d+\.\d+\S*, Python 3\.\d+\.\d+, numpy \d", text)
    date = re.search(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d\d:\d\d", text)
    assert date is not None
    assert datetime.fromisoformat(date.group()) >= before


def test_a_folder_of_many_files_is_one_row_that_changes_with_each_of_them(tmp_path: Path) -> None:
    for number in range(20):
        (tmp_path / f"{number:02d}.csv").write_text(str(number))
    (first,) = provenance([tmp_path]).files
    assert first.name == f"{tmp_path}/ (20 files)"
    assert first.size_bytes == 10 + 2 * 10
    (tmp_path / "07.csv").write_text("8")
    (changed,) = provenance([tmp_path]).files
    assert changed.sha256 != first.sha256


@pytest.mark.long
@pytest.mark.parametrize("made", ["sections", "explained"])
def test_a_browser_shows_it_without_scrolling_aside(request: pytest.FixtureRequest, made: str) -> None:
    program = chromium()
    if program is None:
        pytest.skip("no Chromium on this machine")
    width_px, letter_px = measured(program, request.getfixturevalue(made))
    assert width_px <= NARROW_PX
    assert letter_px >= SMALLEST_LETTER_PX


@pytest.mark.parametrize("package", ["jinja2", "matplotlib"])
def test_without_what_renders_it_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(UserError, match=r"needs the extra 'lab': pip install 'gaiteyes\[lab\]'"):
        write_sections(tmp_path / "page.html", "", "", (), [])
    assert not list(tmp_path.iterdir())


def test_a_page_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"absent/page\.html: No such file or directory"):
        write_sections(tmp_path / "absent" / "page.html", "", "", (), [])


def test_a_clock_that_began_long_ago_and_few_decades_have_numbers_of_their_own() -> None:
    late = drawing("late", lambda axes: axes.plot([84213.25, 84213.5], [0.0, 1.0]))
    assert ">84213.30<" in late
    assert "+8.4" not in late

    def few(axes: "Axes") -> None:
        axes.plot([0.2, 10.0], [1e-8, 1e-4])
        axes.set(xscale="log", yscale="log", xlim=(0.2, 10.0))

    labels = re.findall(r">([\d.e\u2212]+)</text>", drawing("few", few))
    assert {"0.2", "0.5", "1", "2", "5", "10"} <= set(labels)
    assert "1e\N{MINUS SIGN}06" in labels
    assert not any(label.startswith(("2e", "5e")) for label in labels)
