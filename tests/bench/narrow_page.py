"""A page as a telephone shows it, in a headless Chromium: what its layout measures, and a picture of it.

A window of Chromium is no narrower than 500 pixels, so the page stands in a frame of its own.
"""

import os
import re
import subprocess
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

NARROW_PX = 420
_AROUND = """<body style="margin:0">
<iframe id="page" width="{width}" height="{height}" style="border:0" srcdoc="{page}"></iframe><script>
const page = document.getElementById("page");
page.onload = () => {{
  const inside = page.contentDocument;
  const sizes = [...inside.querySelectorAll("main *:not(svg *)")].map(
    (each) => parseFloat(getComputedStyle(each).fontSize));
  document.body.dataset.found = inside.documentElement.scrollWidth + " " + Math.min(...sizes);
}};
</script></body>"""


def measured(program: str, page: Path) -> tuple[int, float]:
    """Return how wide the page's content is and how large its smallest letters are outside drawings, in pixels."""
    shown = _run(program, page, 900, "--dump-dom")
    found = re.search(r'data-found="(\d+) ([\d.]+)"', shown)
    assert found is not None, shown[-1000:]
    return int(found[1]), float(found[2])


def photographed(program: str, page: Path, picture: Path, height_px: int) -> None:
    """Write a picture of the page's first `height_px`."""
    with TemporaryDirectory() as folder:
        whole = Path(folder) / "whole.png"
        _run(program, page, height_px, "--hide-scrollbars", f"--window-size=500,{height_px}", f"--screenshot={whole}")
        pixels = cv2.imread(str(whole))
        assert pixels is not None
        picture.parent.mkdir(exist_ok=True)
        assert cv2.imwrite(str(picture), pixels[:height_px, :NARROW_PX])


def _run(program: str, page: Path, height_px: int, *options: str) -> str:
    with TemporaryDirectory() as folder:
        around = Path(folder) / "around.html"
        text = escape(page.read_text(encoding="utf-8"))
        around.write_text(_AROUND.format(width=NARROW_PX, height=height_px, page=text), encoding="utf-8")
        own_root = ("--no-sandbox",) if os.geteuid() == 0 else ()  # it refuses to run as root with its sandbox
        command = [program, "--headless", "--disable-gpu", f"--user-data-dir={folder}/profile", *own_root, *options]
        return subprocess.run(
            [*command, around.as_uri()], capture_output=True, text=True, check=True, timeout=60.0
        ).stdout
