"""JSON for every message without pixels, with the JSON Schema made from the same structs.

A number that is not finite is `null` in JSON and NaN in a struct; no message has an optional field, so the
mapping is exact in both directions. Keys keep the order of the struct's fields.
"""

import math
from typing import Any, TypeVar

import msgspec

from messages.estimates import Stamp
from messages.topics import TOPICS, Topic

M = TypeVar("M", bound=msgspec.Struct)

_ENCODER = msgspec.json.Encoder()


def encode(message: msgspec.Struct) -> bytes:
    """Return `message` as one JSON object; NaN and infinities become null."""
    return _ENCODER.encode(message)


def encode_line(topic: Topic, message: msgspec.Struct, stamp: Stamp | None = None) -> bytes:
    """Return one flat JSON object: `topic`, the message's own keys and, when published, the stamp's."""
    fields: dict[str, Any] = {"topic": topic.name} | msgspec.structs.asdict(message)
    if stamp is not None:
        fields |= msgspec.structs.asdict(stamp)
    return _ENCODER.encode(fields)


def decode(data: bytes | str, message: type[M]) -> M:
    """Return the `message` struct that `data` holds; null becomes NaN.

    Raises msgspec.ValidationError, naming the field, where `data` does not fit; unknown keys are ignored.
    """
    return msgspec.convert(_null_to_nan(msgspec.json.decode(data)), message)


def decode_line(data: bytes | str, message: type[M]) -> tuple[str, M, Stamp]:
    """Return what `encode_line` wrote of a published estimate: the topic's name, the `message` and its stamp.

    Raises msgspec.ValidationError, naming the field, where `data` does not fit; unknown keys are ignored.
    """
    fields = _null_to_nan(msgspec.json.decode(data))
    return msgspec.convert(fields, _Line).topic, msgspec.convert(fields, message), msgspec.convert(fields, Stamp)


class _Line(msgspec.Struct):
    topic: str


def _null_to_nan(value: Any) -> Any:
    if value is None:
        return float("nan")
    if isinstance(value, list):
        return [_null_to_nan(item) for item in value]
    if isinstance(value, dict):
        return {key: _null_to_nan(item) for key, item in value.items()}
    return value


def json_schema(topic: Topic) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of one topic's message as `encode` writes it."""
    schema: dict[str, Any] = _number_or_null(msgspec.json.schema(topic.message))
    return schema


def published_schemas() -> dict[str, dict[str, Any]]:
    """Return the schema of every published topic, the publisher's stamp included, by topic name."""
    return {name: _published_schema(topic) for name, topic in TOPICS.items() if topic.published}


def _published_schema(topic: Topic) -> dict[str, Any]:
    parts, definitions = msgspec.json.schema_components([topic.message, Stamp], ref_template="#/$defs/{name}")
    schema: dict[str, Any] = _number_or_null({"allOf": list(parts), "$defs": definitions})
    return schema


def _number_or_null(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_number_or_null(item) for item in schema]
    if isinstance(schema, dict):
        mapped = {key: _number_or_null(item) for key, item in schema.items()}
        return mapped | {"type": ["number", "null"]} if mapped.get("type") == "number" else mapped
    if isinstance(schema, float) and not math.isfinite(schema):
        return None  # a default
    return schema
