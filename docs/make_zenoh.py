"""Writes docs/zenoh.md, every topic and field on Zenoh, out of the messages themselves: `python docs/make_zenoh.py`."""

import enum
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

import msgspec

from messages import TOPICS, Stamp
from messages.topics import INTERFACE_VERSION, Topic

PAGE = Path(__file__).parent / "zenoh.md"

HEAD = f"""# On Zenoh

For whoever subscribes. This page is made from the messages by `python docs/make_zenoh.py`; how to subscribe, in Python
or without the project's library, stands in [listening](listening.md), who may connect in
[on hardware](hardware.md#who-may-listen).

Each message is one JSON object: `topic`, the fields of the message, and those of the [stamp](#stamp). A number that is
not known is `null`, in lists too. Units and frames are the ends of the names: `_m`, `_rad`, `_ns`; `H`, `B`, `W` are
explained in [architecture](architecture.md#frames-units-time). Times are nanoseconds of the sender's CLOCK_MONOTONIC; a
covariance is the upper triangle (00, 01, 02, 11, 12, 22) of a symmetric matrix.

| key | what it is |
| --- | --- |
| `gaiteyes/DEVICE/TOPIC/v{INTERFACE_VERSION}` | published; the version rises when a message means something else |
| `gaiteyes/DEVICE/replay/TOPIC/v{INTERFACE_VERSION}` | the same of a replay |
| `gaiteyes/DEVICE/alive` | liveliness token: presence, no watchdog (its lease is 10 s) |
| `gaiteyes/DEVICE/calibration`, `…/configuration` | to be asked: what is in use |
| `gaiteyes/DEVICE/schema` | to be asked: the JSON Schema of every published message |

Subscribe to keys below `gaiteyes/` and ask for exact ones: anything wider gets nothing, silently. DEVICE is the
configuration's `device`, `demo` for the simulated wearer.
"""


def page() -> str:
    """Return the page."""
    published = [topic for topic in TOPICS.values() if topic.published]
    parts = [HEAD, _overview(published), *(_told(topic) for topic in published), _stamp()]
    inside = list(dict.fromkeys(each for topic in published for each in _structs_of(topic.message)))
    parts += ["## Inside these messages\n", *(_described(struct, "###") for struct in inside)]
    words = list(dict.fromkeys(each for topic in published for each in _enums_of(topic.message)))
    words += [each for each in _enums_of(Stamp) if each not in words]
    return "\n".join([*parts, _words(words)])


def _overview(topics: list[Topic]) -> str:
    lines = ["| topic | message | a second | deadline |", "| --- | --- | ---: | ---: |"]
    lines += [
        f"| [`{topic.name}`](#{topic.name}) | `{topic.message.__name__}` | {topic.rate_hz:g} | "
        f"{1e3 * topic.deadline_s:g} ms |"
        for topic in topics
    ]
    told = (
        "The deadline counts from the instant that the message's time names; a receiver refuses what is older. Of what "
        "cannot be sent in time only the newest is kept."
    )
    return "\n".join([*lines, "", told, ""])


def _told(topic: Topic) -> str:
    return _described(topic.message, "##", topic.name)


def _stamp() -> str:
    return _described(Stamp, "##", "stamp")


def _described(struct: type[msgspec.Struct], level: str, title: str = "") -> str:
    text = " ".join((inspect.getdoc(struct) or "").split())
    lines = [f"{level} {title or struct.__name__}\n", f"{text}\n", "| field | type |", "| --- | --- |"]
    lines += [f"| `{name}` | {_type(told)} |" for name, told in _hints(struct).items()]
    return "\n".join(lines) + "\n"


def _hints(struct: type[msgspec.Struct]) -> dict[str, Any]:
    return {field.name: field.type for field in msgspec.structs.fields(struct)}


def _type(told: Any) -> str:
    """Return a type in a reader's words, as it stands in JSON."""
    arguments = get_args(told)
    if isinstance(told, type) and issubclass(told, enum.Enum):
        return f"[`{told.__name__}`](#words)"
    if isinstance(told, type) and issubclass(told, msgspec.Struct):
        return f"[`{told.__name__}`](#{told.__name__.lower()})"
    if get_origin(told) is tuple and arguments[-1] is Ellipsis:
        return f"list of {_type(arguments[0])}"
    if get_origin(told) is tuple:
        return f"{len(arguments)} numbers"
    if get_origin(told) is dict:
        return f"object: a number for each {_type(arguments[0])}"
    if arguments:
        return " or ".join(_type(each) for each in arguments)
    return {float: "number or null", int: "integer", str: "text", bool: "true or false", type(None): "null"}[told]


def _within(told: Any) -> Iterator[Any]:
    yield told
    for each in get_args(told):
        yield from _within(each)


def _parts(struct: type[msgspec.Struct], kind: type) -> Iterator[Any]:
    for told in _hints(struct).values():
        for each in _within(told):
            if isinstance(each, type) and issubclass(each, kind):
                yield each
            if isinstance(each, type) and issubclass(each, msgspec.Struct):
                yield from _parts(each, kind)


def _structs_of(struct: type[msgspec.Struct]) -> Iterator[type[msgspec.Struct]]:
    yield from _parts(struct, msgspec.Struct)


def _enums_of(struct: type[msgspec.Struct]) -> Iterator[type[enum.Enum]]:
    yield from _parts(struct, enum.Enum)


def _words(enums: list[type[enum.Enum]]) -> str:
    lines = ["## Words\n", "What each reason asks for: [safety](safety.md#reasons-and-what-each-asks-for).\n"]
    lines += ["| type | values |", "| --- | --- |"]
    for each in enums:
        lines.append(f"| `{each.__name__}` | {', '.join(f'`{word.value}`' for word in each)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    made = page()
    if "--check" in sys.argv[1:]:
        is_new = PAGE.exists() and PAGE.read_text(encoding="utf-8") == made
        sys.exit(0 if is_new else f"{PAGE}: out of date; run python docs/make_zenoh.py")
    PAGE.write_text(made, encoding="utf-8")
