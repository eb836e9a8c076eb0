"""The project's Markdown pages, and what in them a test can check: links, anchors, code."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]

_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"^(?: {4}\S.*\n)+", re.MULTILINE)
_SPAN = re.compile(r"`([^`\n]+)`")
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_IMAGE = re.compile(r'<img [^>]*\bsrc="([^"]+)"')
_HEADING = re.compile(r"^#+ +(.*)$", re.MULTILINE)


def pages() -> list[Path]:
    """Return every Markdown page of the project."""
    return sorted((*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")))


def links(text: str) -> list[str]:
    """Return the targets of the links and pictures in a page that do not lead out of the project."""
    prose = _FENCE.sub("", text)
    targets = _LINK.findall(prose) + _IMAGE.findall(prose)
    return [target for target in targets if "://" not in target and not target.startswith("mailto:")]


def outside_links(text: str) -> list[str]:
    """Return the targets of the links in a page that lead out of the project."""
    return [target for target in _LINK.findall(_FENCE.sub("", text)) if "://" in target]


def anchors(text: str) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = _HEADING.findall(_FENCE.sub("", text))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def code(text: str) -> Iterator[str]:
    """Yield the lines of a page's code blocks, without comments, and its code spans."""
    for block in (*_FENCE.findall(text), *_INDENTED.findall(text)):
        for line in block.splitlines():
            yield line.split(" #")[0].strip()
    yield from _SPAN.findall(_FENCE.sub("", text))
