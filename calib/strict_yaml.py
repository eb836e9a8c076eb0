"""YAML for numbers: read without surprises, written so that every float survives exactly.

Against plain YAML 1.1 as PyYAML reads it: `1e-5` is a number, a key may stand only once in its mapping, and anchors
and aliases are refused.
"""

import re
from collections.abc import Hashable, Mapping
from pathlib import Path

import yaml

from messages import UserError

_FLOAT_TAG = "tag:yaml.org,2002:float"
_EXPONENT = re.compile(r"^[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
_ONE_LINE_WIDTH = 200


class CalibrationError(UserError):
    """A calibration file cannot be used. One clear line: the file, the field, the allowed range."""


class _Loader(yaml.SafeLoader):
    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            alias: yaml.Event = self.get_event()  # type: ignore[no-untyped-call]  # PyYAML's stubs leave it so
            mark = alias.start_mark if isinstance(alias.start_mark, yaml.Mark) else None
            raise yaml.MarkedYAMLError(problem="aliases are not allowed", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        keys = set[object]()
        for key_node, _ in node.value:
            if key_node.value in keys:
                raise yaml.MarkedYAMLError(
                    problem=f"key '{key_node.value}' stands twice", problem_mark=key_node.start_mark
                )
            keys.add(key_node.value if isinstance(key_node, yaml.ScalarNode) else id(key_node))
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002  # PyYAML calls it with each value
        return True


for _class in (_Loader, _Dumper):
    _class.add_implicit_resolver(_FLOAT_TAG, _EXPONENT, list("-+.0123456789"))


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file; raises CalibrationError with one line."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise CalibrationError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{path}: not UTF-8 text (byte {error.start})") from error


def parse_yaml(text: str, where: str) -> object:
    """Return what the YAML document `text` holds; raises CalibrationError with one line that begins with `where`."""
    try:
        document: object = yaml.load(text, _Loader)
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
