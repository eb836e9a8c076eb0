"""What a C3D file holds, read by ezc3d in a process of its own.

A file that is damaged can crash the C++ library or keep it busy for ever. So another interpreter reads it, with bounds
on its time and memory, and writes what it found to its standard output; whatever ends it is one line here.
"""

import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from messages.arrays import FloatArray
from messages.errors import UserError
from messages.extras import needs

LONGEST_S = 60.0
"""A hundred times what ten minutes of motion capture take."""
MEMORY_BYTES = 2 << 30
MEMORY_PER_BYTE = 64
"""ezc3d keeps each value as an object: the child may use `MEMORY_BYTES`, and so much more for each byte of the file."""

_CHILD = "import sys; sys.path[:] = {path!r}; from impedance.recording.c3d_file import write_contents; write_contents()"


class Channels(NamedTuple):
    """One of the two kinds of data: `values` (k, n, t) of n channels at t times, k numbers each; labels, units, rate.

    `rate_hz` is None where the file does not say.
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    rate_hz: float | None
    values: FloatArray


class Event(NamedTuple):
    """What happened at `t_s` from the first sample on, by its label and context, such as Foot Strike and Right."""

    label: str
    context: str
    t_s: float


class C3dContents(NamedTuple):
    """The markers' coordinates, in the file's unit, and the analog channels; k is 3 and 1.

    `platforms` is group FORCE_PLATFORM as it stands, `events` are group EVENT's, by time.
    """

    points: Channels
    analogs: Channels
    platforms: dict[str, FloatArray]
    events: tuple[Event, ...]


class _Sent(msgspec.Struct):
    """Channels on their way from the child."""

    labels: list[str]
    units: list[str]
    rate_hz: float | None
    shape: tuple[int, int, int]
    values: bytes


class _SentArray(msgspec.Struct):
    shape: tuple[int, ...]
    values: bytes


class _SentFile(msgspec.Struct):
    points: _Sent
    analogs: _Sent
    platforms: dict[str, _SentArray]
    events: list[tuple[str, str, float]]


def read_contents(path: Path, longest_s: float = LONGEST_S) -> C3dContents:
    """Return what the file holds; raises UserError, one line, where ezc3d is absent or the file cannot be read."""
    needs("a C3D file", "ezc3d")
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    command = [sys.executable, "-I", "-c", _CHILD.format(path=sys.path), str(path.absolute())]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=longest_s, check=False)
    except subprocess.TimeoutExpired as error:
        raise UserError(f"{path}: not a C3D file (reading it takes longer than {longest_s:g} s)") from error
    if done.returncode:
        raise UserError(f"{path}: not a C3D file ({_last_words(done)})")
    try:
        sent = msgspec.msgpack.decode(done.stdout, type=_SentFile)
    except msgspec.MsgspecError as error:
        raise UserError(f"{path}: not a C3D file ({error})") from error
    platforms = {
        name: np.frombuffer(each.values, dtype=np.float64).reshape(each.shape) for name, each in sent.platforms.items()
    }
    events = sorted((Event(*event) for event in sent.events), key=lambda event: event.t_s)
    return C3dContents(_received(sent.points), _received(sent.analogs), platforms, tuple(events))


def write_contents() -> None:
    """Be the child: read the file that the command line names within bounds, write what it holds."""
    import ezc3d

    path = Path(sys.argv[1])
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages_in_use = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    bound = pages_in_use * resource.getpagesize() + MEMORY_BYTES + MEMORY_PER_BYTE * path.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    file = ezc3d.c3d(str(path))
    points, analogs = (np.asarray(file["data"][name], dtype=np.float64) for name in ("points", "analogs"))
    parameters = file["parameters"]
    first_s = float(file["header"]["points"]["first_frame"]) / float(file["header"]["points"]["frame_rate"])
    whole = _SentFile(
        _sent(parameters, "POINT", points[:3]),
        _sent(parameters, "ANALOG", analogs[:1]),
        _platforms(parameters),
        _events(parameters, first_s),
    )
    sys.stdout.buffer.write(msgspec.msgpack.encode(whole))


def _platforms(parameters: Any) -> dict[str, _SentArray]:
    """Return the numbers of group FORCE_PLATFORM."""
    found: dict[str, _SentArray] = {}
    if "FORCE_PLATFORM" not in parameters:
        return found
    group = parameters["FORCE_PLATFORM"]
    for name in ("TYPE", "CORNERS", "ORIGIN", "CHANNEL", "CAL_MATRIX"):
        if name in group and len(group[name]["value"]):
            value = np.asarray(group[name]["value"], dtype=np.float64)
            found[name] = _SentArray(value.shape, value.tobytes())
    return found


def _events(parameters: Any, first_s: float) -> list[tuple[str, str, float]]:
    """Return label, context and time of group EVENT's; TIMES are minutes and seconds from the recording's begin."""
    if "EVENT" not in parameters or "TIMES" not in parameters["EVENT"]:
        return []
    group = parameters["EVENT"]
    times = np.asarray(group["TIMES"]["value"], dtype=np.float64).reshape(2, -1)
    labels, contexts = (list(group[name]["value"]) if name in group else [] for name in ("LABELS", "CONTEXTS"))
    return [
        (str(labels[k]).strip(), str(contexts[k]).strip() if k < len(contexts) else "", 60.0 * t[0] + t[1] - first_s)
        for k, t in enumerate(times.T[: len(labels)].tolist())
    ]


def _sent(parameters: Any, group: str, values: FloatArray) -> _Sent:
    def told(name: str) -> list[Any]:
        return list(parameters[group][name]["value"]) if group in parameters and name in parameters[group] else []

    rates = told("RATE")
    return _Sent(
        [str(label).strip() for label in told("LABELS")],
        [str(unit).strip() for unit in told("UNITS")],
        float(rates[0]) if rates else None,
        values.shape,
        values.tobytes(),
    )


def _received(sent: _Sent) -> Channels:
    values = np.frombuffer(sent.values, dtype=np.float64).reshape(sent.shape)
    return Channels(tuple(sent.labels), tuple(sent.units), sent.rate_hz, values)


def _last_words(done: subprocess.CompletedProcess[bytes]) -> str:
    if done.returncode < 0:
        return f"reading it ended with {signal.Signals(-done.returncode).name}"
    lines = done.stderr.decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it cannot be read")
