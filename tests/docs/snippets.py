"""The snippets of the project's pages, and how a page's are run: in their order, in one folder, as a reader would.

A fence names its language. `sh` is run by bash with the page's folder as the current one, `python` is a file of its
own, named by a first line `# file: NAME` or by its line; `toml` is a configuration, `c` must compile. `text` is no
snippet. What cannot be run says why in the line before it: `<!-- not run: REASON -->`.
"""

import re
import shlex
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

from tests.docs.pages import ROOT

LANGUAGES = frozenset({"sh", "python", "toml", "c", "text"})
REASON = re.compile(r"needs hardware|needs root|needs the network|takes minutes|a synopsis|run by (?P<test>[\w/.-]+)")

_SNIPPET = re.compile(
    r"^(?:<!-- not run: (?P<reason>.+?) -->\n)?(?P<indent> *)```(?P<language>\w*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
_FILE = re.compile(r"# file: ([\w.]+)\n")


@dataclass(frozen=True)
class Snippet:
    """One fence of a page: where it begins, and why it is not run, if it is not."""

    line: int
    language: str
    text: str
    reason: str | None

    @property
    def file(self) -> str:
        """Return the name of the file that it is put into."""
        named = _FILE.match(self.text)
        return named.group(1) if named else f"line_{self.line}.{self.language}"


def snippets(page: Path) -> list[Snippet]:
    """Return the fences of a page in their order."""
    text = page.read_text(encoding="utf-8")
    return [
        Snippet(
            text.count("\n", 0, found.start("text")),
            found["language"],
            textwrap.dedent(found["text"]),
            found["reason"],
        )
        for found in _SNIPPET.finditer(text)
    ]


def lay_out(page: Path, folder: Path) -> Path:
    """Write what the snippets of `page` that are run need into `folder`; return the script that runs them."""
    commands = folder / "bin"
    commands.mkdir()
    for name, module in (("python", ""), ("gaiteyes", " -m cli.main")):
        (commands / name).write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)}{module} "$@"\n', encoding="utf-8")
        (commands / name).chmod(0o755)
    lines = ["set -eEuo pipefail", f"trap 'echo \"{page.name}: the snippet of line $AT failed\" >&2' ERR"]
    lines.append("trap 'jobs -p | xargs --no-run-if-empty kill' EXIT")
    for snippet in snippets(page):
        if snippet.reason is None and snippet.language in ("sh", "python", "c"):
            lines += [f'AT={snippet.line}; cd "$FOLDER"', _run(snippet)]
            (folder / snippet.file).write_text(snippet.text, encoding="utf-8")
    script = folder / "page.bash"
    script.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return script


def environment(folder: Path, given: dict[str, str]) -> dict[str, str]:
    """Return the environment that a page's script runs in: the project's commands, no other user's services."""
    return given | {
        "FOLDER": str(folder),
        "PROJECT": str(ROOT),
        "PATH": f"{folder / 'bin'}:{given['PATH']}",
        "PYTHONPATH": f"{ROOT}:{folder}",
        "XDG_RUNTIME_DIR": str(folder),
        "COLUMNS": "120",
    }


def _run(snippet: Snippet) -> str:
    if snippet.language == "python":
        return f"python {snippet.file}"
    if snippet.language == "c":
        return f'cc -std=c11 -Wall -Werror -fsyntax-only -I "$PROJECT/examples/c" {snippet.file}'
    return snippet.text
