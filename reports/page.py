"""Renders a report: one HTML file by itself, without a server, a script or anything from elsewhere."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from messages.errors import UserError
from messages.extras import needs
from reports.content import Section
from reports.drawing import AFTER, BEFORE
from reports.provenance import provenance

_TEMPLATES = Path(__file__).parent / "templates"
SECTIONS = _TEMPLATES / "sections.html"
"""The template of a report that is sections alone: `headline`, `lead` and `sections`."""


def check_page(what: str) -> None:
    """Raise UserError, with what to install, if `what` cannot be drawn and rendered."""
    for package in ("matplotlib", "jinja2"):
        needs(what, package)


def rendered(
    template: Path,
    title: str,
    files: Sequence[Path],
    filters: Mapping[str, Callable[..., str]] | None = None,
    **facts: object,
) -> str:
    """Return the page that `template` makes of `facts`; it may extend and import those in `reports/templates`.

    `files` are the files and folders that the report was made from, `filters` show the template's numbers to a person.
    All text is escaped but what the template itself calls safe: drawings.
    Raises UserError where one of them can no longer be read.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folders = [template.parent, _TEMPLATES]
    environment = Environment(
        loader=FileSystemLoader(folders),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= filters or {}
    source = provenance(files)
    return environment.get_template(template.name).render(
        title=title, source=source, before=BEFORE, after=AFTER, **facts
    )


def write_sections(
    path: Path, title: str, headline: str, sections: Sequence[Section], files: Sequence[Path], lead: str = ""
) -> None:
    """Write a report of sections; raises UserError where it cannot, or an extra is missing."""
    check_page(f"a report ({path.name})")
    text = rendered(SECTIONS, title, files, headline=headline, lead=lead, sections=sections)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
