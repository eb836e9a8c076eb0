"""YAML for numbers: read without surprises, written so that every float survives exactly.

Of YAML's scalars there are numbers as JSON has them (and `1e-5`, `.5`, `.nan`), true, false, null and text: no dates,
no octal 0700, no 1:30. A key may stand only once in its mapping; tags, anchors and aliases are refused.
"""

import re
from collections.abc import Hashable, Mapping

import yaml

from messages import UserError
from messages.text_files import refuse_huge_numbers

DEEPEST = 32
"""Levels of nesting; a calibration has five."""

_TAG = "tag:yaml.org,2002:"
_SCALARS = (
    ("bool", re.compile(r"^(?:true|false)$"), "tf"),
    ("null", re.compile(r"^(?:null|~|)$"), ("n", "~", "")),
    ("int", re.compile(r"^[-+]?(?:0|[1-9][0-9]*)$"), "-+0123456789"),
    (
        "float",
        re.compile(r"^[-+]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|\.inf)$|^\.nan$"),
        "-+.0123456789",
    ),
)
_ONE_LINE_WIDTH = 200


class CalibrationError(UserError):
    """A calibration file cannot be used. One clear line: the file, the field, the allowed range."""


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012  # as PyYAML has it
    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: yaml.Event = self.peek_event()  # type: ignore[no-untyped-call]  # PyYAML's stubs leave it so
        mark = event.start_mark if isinstance(event.start_mark, yaml.Mark) else None
        if isinstance(event, yaml.AliasEvent):
            raise yaml.MarkedYAMLError(problem="aliases are not allowed", problem_mark=mark)
        if getattr(event, "tag", None) is not None:
            raise yaml.MarkedYAMLError(problem="tags are not allowed", problem_mark=mark)
        if self._depth == DEEPEST:
            raise yaml.MarkedYAMLError(problem=f"nested deeper than {DEEPEST} levels", problem_mark=mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        keys = set[str]()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(problem="a key must be text", problem_mark=key_node.start_mark)
            if key_node.value in keys:
                raise yaml.MarkedYAMLError(
                    problem=f"key '{key_node.value}' stands twice", problem_mark=key_node.start_mark
                )
            keys.add(key_node.value)
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002  # PyYAML calls it with each value
        return True


for _name, _form, _first in _SCALARS:
    _Loader.add_implicit_resolver(_TAG + _name, _form, list(_first))
_Dumper.add_implicit_resolver(_TAG + "float", _SCALARS[-1][1], list("-+.0123456789"))


def parse_yaml(text: str, where: str) -> object:
    """Return what the YAML document `text` holds; raises CalibrationError with one line that begins with `where`."""
    try:
        document: object = yaml.load(text, _Loader)
        refuse_huge_numbers(document, where)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark is not None else ""
        raise CalibrationError(f"{where}: {line}{error.problem or error.context}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise CalibrationError(f"{where}: {' '.join(str(error).split())}") from error
    except RecursionError as error:
        raise CalibrationError(f"{where}: nested too deeply") from error
    return document


def format_yaml(document: Mapping[str, object]) -> str:
    """Return `document` as YAML with the innermost lists and mappings on one line each."""
    return yaml.dump(
        document, Dumper=_Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True, width=_ONE_LINE_WIDTH
    )
