"""A report as a reader gets it: its text, whether it is well formed, and that it needs nothing from elsewhere."""

import re
from html.parser import HTMLParser
from pathlib import Path

_VOID = ("meta", "br", "path", "rect", "use")


class Page(HTMLParser):
    """Collects text, and refuses what is open or from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag not in ("script", "link", "img", "iframe")
        for name, value in attrs:
            if name in ("src", "href", "xlink:href"):
                assert (value or "").startswith("#"), f"{tag} needs {value}"
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in _VOID:
            assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def read(path: Path) -> str:
    """Return a page's text, its spaces made one; raises AssertionError where it is not well formed."""
    page = Page()
    page.feed(re.sub(r"<\?xml.*?>|<!DOCTYPE.*?>", "", path.read_text(encoding="utf-8"), flags=re.DOTALL))
    assert page.open == []
    return " ".join(" ".join(page.text).split())
