"""Whatever the pages name exists: linked files and headings, commands with their options, modules, targets, tests."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from cli.main import app
from tests.docs.pages import ROOT, anchors, code, links, outside_links, pages

PAGES = pages()
TOP_LEVEL = sorted(path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith("."))

_WORD = re.compile(r"[a-z][a-z0-9-]*")
_OPTION = re.compile(r"--[a-z][a-z0-9-]*")
_GAITEYES = re.compile(r"(?:^|[ /])gaiteyes +([a-z].*)$")
_MODULE = re.compile(r"python -m ([\w.]+)(.*)$")
_MAKE = re.compile(r"(?:^|sudo )make +([a-z][a-z-]*)")
_PATH = re.compile(rf"(?<![\w/.-])(?:{'|'.join(TOP_LEVEL)})/[\w./-]*\w/?")
_ZENOH_KEY = re.compile(r"gaiteyes/[\w/]+$")
_DOTTED = re.compile(rf"^(?:{'|'.join(TOP_LEVEL)})(?:\.\w+)+$")
_OUTSIDE = re.compile(r"https://[\w.-]+\.[a-z]{2,}(?:/[\w./~%#?=&-]*)?")
_BRACES = re.compile(r"\{[^}]*\}")

every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


@every_page
def test_links_lead_to_files_and_headings(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in links(text):
        name, _, anchor = target.partition("#")
        linked = (page.parent / name).resolve() if name else page
        assert linked.exists(), target
        if anchor:
            assert anchor in anchors(linked.read_text(encoding="utf-8")), target


@every_page
def test_links_that_lead_out_are_whole(page: Path) -> None:
    """Whether the other end is there is not asked: a test needs no network."""
    for target in outside_links(page.read_text(encoding="utf-8")):
        assert _OUTSIDE.fullmatch(target), target


@every_page
def test_commands_of_gaiteyes_exist_with_their_options(page: Path) -> None:
    for line in _code(page):
        for called in _GAITEYES.findall(line):
            assert _missing(called) is None, (line, _missing(called))


@every_page
def test_modules_that_are_run_exist_with_their_options(page: Path) -> None:
    for line in _code(page):
        for module, rest in _MODULE.findall(line):
            if module.split(".")[0] in TOP_LEVEL:
                source = _source_of(module)
                assert source is not None, line
                assert all(option in source for option in _OPTION.findall(rest)), line


@every_page
def test_make_targets_exist(page: Path) -> None:
    targets = set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = {target for line in _code(page) for target in _MAKE.findall(line)}
    assert named <= targets, named - targets


@every_page
def test_paths_and_names_of_the_project_exist(page: Path) -> None:
    for line in _code(page):
        for path in _PATH.findall(_BRACES.sub("", line)):
            assert (ROOT / path).exists() or _ZENOH_KEY.match(path), path
        if _DOTTED.match(line) and not line.endswith((".toml", ".service", ".dbc")):
            assert _is_named(line), line


def _code(page: Path) -> Iterator[str]:
    return code(page.read_text(encoding="utf-8"))


def _missing(called: str) -> str | None:
    """Return what is missing of a command line after `gaiteyes`: a sub-command or an option; None if nothing is."""
    command: Any = get_command(app)
    words = called.replace("[", " ").replace("]", " ").split()
    while words and hasattr(command, "commands"):
        word = words.pop(0)
        if word not in command.commands:
            placeholder = not _WORD.fullmatch(word)  # SYSTEM, … stand for one of several
            return None if placeholder else word
        command = command.commands[word]
    known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    return next((word for word in words if _OPTION.fullmatch(word) and word not in {*known, "--help"}), None)


def _source_of(module: str) -> str | None:
    """Return the text of a module, or of the package that is run in its name."""
    base = ROOT.joinpath(*module.split("."))
    for path in (base.with_suffix(".py"), base / "__main__.py"):
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return None


def _is_named(dotted: str) -> bool:
    """Return whether the first parts of a name are a module or package, and the rest stands in the module's text."""
    place, parts = ROOT, dotted.split(".")
    while parts and (place / parts[0]).is_dir():
        place /= parts.pop(0)
    if not parts:
        return True
    source = place / f"{parts[0]}.py"
    parts = parts[1:] if source.is_file() else parts
    text = (source if source.is_file() else place / "__init__.py").read_text(encoding="utf-8")
    return all(re.search(rf"\b{part}\b", text) for part in parts)
