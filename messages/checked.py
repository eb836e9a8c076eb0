"""From a parsed file to a checked struct; a mistake is one line: file, field, what stands there, what is allowed."""

import difflib
import re
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from messages.errors import UserError

M = TypeVar("M", bound=msgspec.Struct)

HEXADECIMAL = {"written": "hexadecimal"}
"""`extra` of the `msgspec.Meta` of a whole number that people write in base 16, as the address of a chip."""

_SEAT = re.compile(r"^(?P<problem>.*?)(?: - at `\$\.?(?P<field>.*)`)?$")
_MISSING = re.compile(r"^Object missing required field `(.*)`$")


def checked(document: object, kind: type[M], where: str) -> M:
    """Return what `document` (mappings, lists, numbers, strings) says as a `kind`.

    Raises UserError, its line beginning with `where`, for an unknown or missing field, a wrong type, or a value
    outside the field's range; a mistyped key is not silently ignored.
    """
    _refuse_unknown_keys(document, inspect.type_info(kind), "", where)
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        raise UserError(f"{where}: {_reworded(str(error), document, kind)}") from error


def _refuse_unknown_keys(value: object, expected: inspect.Type, path: str, where: str) -> None:
    if not (isinstance(value, dict) and isinstance(expected, inspect.StructType)):
        return
    types = {field.encode_name: field.type for field in expected.fields}
    for key, item in value.items():
        field = f"{path}.{key}" if path else str(key)
        if key not in types:
            near = difflib.get_close_matches(str(key), types, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"allowed: {', '.join(types)}"
            raise UserError(f"{where}: {field} is not a known field; {hint}")
        _refuse_unknown_keys(item, types[key], field, where)


def _reworded(message: str, document: object, kind: type[msgspec.Struct]) -> str:
    seat = _SEAT.match(message)
    if seat is None:
        return message
    problem, field = seat["problem"], seat["field"] or ""
    missing = _MISSING.match(problem)
    if missing is not None:
        return f"{field}.{missing[1]} is missing".lstrip(".")
    found = _at(document, field)
    allowed = _allowed(inspect.type_info(kind), field)
    if allowed and found is not None:
        shown = f"{found:#x}" if type(found) is int and is_hexadecimal(kind, field) else repr(found)
        return f"{field} is {shown}, allowed {allowed}"
    return f"{field or 'the file'}: {problem[0].lower()}{problem[1:]}"


def _at(document: object, field: str) -> object:
    value: Any = document
    for step in field.split("."):
        value = value.get(step) if isinstance(value, dict) else None
    return value


def is_hexadecimal(kind: type[msgspec.Struct], field: str) -> bool:
    """Return whether a field, as `imu.address`, is a number that people write in base 16."""
    found = _field(inspect.type_info(kind), field)
    return isinstance(found, inspect.Metadata) and found.extra == HEXADECIMAL


def _field(expected: inspect.Type, field: str) -> inspect.Type:
    for step in field.split("."):
        if not isinstance(expected, inspect.StructType):
            return inspect.AnyType()
        expected = next((f.type for f in expected.fields if f.encode_name == step), inspect.AnyType())
    return expected


def _allowed(kind: inspect.Type, field: str) -> str:
    """Return the range of a field in words, or nothing where it has none."""
    expected, as_written = _field(kind, field), "{:g}"
    if isinstance(expected, inspect.Metadata):
        as_written = "{:#x}" if expected.extra == HEXADECIMAL else as_written
        expected = expected.type
    if isinstance(expected, inspect.UnionType):
        expected, *_ = (kind for kind in expected.types if not isinstance(kind, inspect.NoneType))
    if isinstance(expected, inspect.EnumType):
        return "one of " + ", ".join(str(member.value) for member in expected.cls)
    if isinstance(expected, inspect.IntType | inspect.FloatType):
        number = "a whole number" if isinstance(expected, inspect.IntType) else "a number"
        bounds = ((expected.ge, "from"), (expected.gt, "above"), (expected.le, "to"), (expected.lt, "below"))
        return " ".join(
            [number, *(f"{word} {as_written.format(bound)}" for bound, word in bounds if bound is not None)]
        )
    if isinstance(expected, inspect.StrType):
        return f"text like {expected.pattern}" if expected.pattern else "text"
    return "true or false" if isinstance(expected, inspect.BoolType) else ""
