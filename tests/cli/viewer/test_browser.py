"""What a person sees, and what the browser asks for: nothing beyond this server. Needs a Chromium of the machine's."""

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from cli.viewer.board import Board
from cli.viewer.server import ViewServer
from daemon.pictures import jpeg
from tests.bench.browser import Page, browser, chromium
from tests.docs.pages import ROOT

PROGRAM = chromium()
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(PROGRAM is None, reason="no Chromium on this machine (apt install chromium)"),
]
README_PICTURE = ROOT / "docs" / "pictures" / "view.jpg"


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    assert PROGRAM is not None
    with browser(PROGRAM) as page:
        yield page


@pytest.fixture
def server() -> Iterator[ViewServer]:
    board = Board("walk <b>bold</b>")
    board.set_facts({"source": "live", "status": "valid", "ground": "slope +1.0°", "health": [("load", "normal")]})
    for k in range(100):
        slope = 3.0 * math.sin(0.1 * k)
        board.add_point((0.05 * k, slope, slope - 1, slope + 1, 0.5, None, 90.0, 89.0, 91.0, None, 45.0, 1.0, 70.0))
    board.set_picture(jpeg(np.full((360, 640, 3), (40, 200, 40), np.uint8)))
    with ViewServer(board, 0, lambda _said: None) as server:
        yield server


def test_the_page_asks_this_server_alone_and_shows_what_it_got(page: Page, server: ViewServer) -> None:
    page.requests.clear()
    page.open(server.url)
    page.wait_until("Number(document.getElementById('picture').dataset.drawn) > 0")
    assert {urlsplit(url).netloc for url in page.requests} == {urlsplit(server.url).netloc}
    assert {Path(urlsplit(url).path).name for url in page.requests} >= {"view.js", "uPlot.iife.min.js", "data"}
    assert page.errors == []
    text = page.evaluate("document.body.innerText")
    assert all(words in text for words in ("walk <b>bold</b>", "slope +1.0°", "normal"))
    blue, green, red = 40, 200, 40
    seen = page.evaluate("[...document.getElementById('picture').getContext('2d').getImageData(300, 200, 1, 1).data]")
    np.testing.assert_allclose(seen[:3], (red, green, blue), atol=8)
    for chart in ("slope", "height", "tilt", "delay"):
        assert page.evaluate(_COLOURED.format(chart)) > 50, chart


def test_the_policy_stops_what_would_leave_the_machine(page: Page, server: ViewServer) -> None:
    page.open(server.url)
    page.wait_until("document.readyState === 'complete'")
    tried = page.evaluate(
        "new Promise(told => { addEventListener('securitypolicyviolation', event => told(event.blockedURI));"
        " fetch('https://example.com/').catch(() => {}); })"
    )
    assert tried == "https://example.com/"


def test_it_is_legible_at_420_px(page: Page, server: ViewServer) -> None:
    page.resize(420, 900)
    page.open(server.url)
    page.wait_until("Number(document.getElementById('picture').dataset.drawn) > 0")
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert page.evaluate("document.getElementById('charts').getBoundingClientRect().width") > 350


def test_the_readme_s_picture_is_what_its_script_makes(tmp_path: Path) -> None:
    made = tmp_path / "view.jpg"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "docs/make_view_picture.py", str(made)], cwd=ROOT, env=environment, check=True)
    new, old = cv2.imread(str(made)), cv2.imread(str(README_PICTURE))
    assert new is not None
    assert old is not None
    rows = min(len(new), len(old))
    assert abs(len(new) - len(old)) < 60  # other fonts
    assert new.shape[1] == old.shape[1]
    smooth = [cv2.GaussianBlur(each[:rows], (0, 0), 6.0).astype(float) for each in (new, old)]
    assert np.abs(smooth[0] - smooth[1]).mean() < 6.0


_COLOURED = """(() => {{ const canvas = document.querySelector('#{0} canvas');
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let k = 0; k < data.length; k += 4) {{
    const [r, g, b, a] = data.slice(k, k + 4);
    if (a > 200 && Math.max(r, g, b) - Math.min(r, g, b) > 60) count += 1;
  }}
  return count; }})()"""
