"""The picture in docs/your-data.md: `python docs/make_report_picture.py [FILE]` makes it anew.

It is the report that the page's own example writes, as a telephone shows it. Needs the extra `lab` and a Chromium.
"""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.bench.browser import chromium
from tests.bench.narrow_page import photographed
from tests.docs.snippets import environment, snippets

PAGE = Path(__file__).parent / "your-data.md"
PICTURE = Path(__file__).parent / "pictures" / "report.png"
HEIGHT_PX = 1000


def make(picture: Path, program: str) -> None:
    """Write the picture, taken with the browser `program`."""
    with TemporaryDirectory(prefix="gd-") as name:
        folder = Path(name)
        example = [each for each in snippets(PAGE) if each.language == "python"]
        for each in example:
            (folder / each.file).write_text(each.text, encoding="utf-8")
        own = environment(folder, dict(os.environ))
        subprocess.run([sys.executable, example[-1].file], cwd=folder, env=own, check=True, stdout=subprocess.DEVNULL)
        photographed(program, folder / "explained" / "report.html", picture, HEIGHT_PX)


if __name__ == "__main__":
    found = chromium()
    if found is None:
        sys.exit("no Chromium on this machine: apt install chromium")
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE, found)
