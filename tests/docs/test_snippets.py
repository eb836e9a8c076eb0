"""Every snippet of the pages runs, or says why it cannot."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.config import parse_configuration
from tests.bench.zed_conf_file import conf, sections
from tests.docs.pages import ROOT, pages
from tests.docs.snippets import LANGUAGES, REASON, environment, lay_out, snippets

TASKS = ("first-run", "wearing", "calibration", "listening", "your-data", "extending", "hardware")
"""Pages that lead a reader step by step."""
PATIENCE_S = 300.0

SIGNATURES = "api.md"
"""The page whose fences are no snippets, but how names are called."""

WITH_SNIPPETS = [page for page in pages() if snippets(page) and page.name != SIGNATURES]
RUN = [
    page
    for page in WITH_SNIPPETS
    if any(each.reason is None and each.language in ("sh", "python", "c") for each in snippets(page))
]


def _marks(page: Path) -> list[pytest.MarkDecorator]:
    in_real_time = any("gaiteyes demo" in each.text for each in snippets(page) if each.reason is None)
    return [pytest.mark.long, pytest.mark.realtime] if in_real_time else [pytest.mark.long]


def _named(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder with a short name: sockets in it must fit the kernel's 108 bytes."""
    with tempfile.TemporaryDirectory(prefix="gd-") as name:
        yield Path(name)


@pytest.mark.parametrize("page", [pytest.param(page, marks=_marks(page), id=_named(page)) for page in RUN])
def test_the_snippets_of_a_page_run(page: Path, folder: Path) -> None:
    for tool in ("bash", "cc"):
        if shutil.which(tool) is None:
            pytest.skip(f"no {tool}")
    conf(folder, sections())
    script = lay_out(page, folder)
    command, own = ["bash", str(script)], environment(folder, dict(os.environ))
    done = subprocess.run(command, env=own, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"


@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=_named)
def test_what_is_not_run_says_why(page: Path) -> None:
    for snippet in snippets(page):
        assert snippet.language in LANGUAGES, f"line {snippet.line}: which language?"
        if snippet.reason is not None:
            known = REASON.fullmatch(snippet.reason)
            assert known, f"line {snippet.line}: {snippet.reason}"
            assert known["test"] is None or (ROOT / known["test"]).is_file(), f"line {snippet.line}: {snippet.reason}"


@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=_named)
def test_settings_are_those_of_the_configuration(page: Path) -> None:
    for snippet in snippets(page):
        if snippet.language == "toml" and snippet.reason is None:
            parse_configuration(snippet.text, f"{page.name}:{snippet.line}")


@pytest.mark.parametrize("name", TASKS)
def test_a_page_for_a_task_states_its_limits_and_the_readme_leads_to_it(name: str) -> None:
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    assert name in ("extending", "hardware") or "\n## Limits\n" in text
    assert f"(docs/{name}.md" in (ROOT / "README.md").read_text(encoding="utf-8")
