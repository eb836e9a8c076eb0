"""The layout of CAN frames, after `gaiteyes.dbc`: scales, words, Data IDs and cycle times stand there alone, so that an
analyser, `cantools generate_c_source` and this module read one contract. `messages.can_encoder` makes frames.

A number that is NaN travels as the raw value named `not_available`, never as zero.
"""

import enum
import functools
import math
from collections.abc import Callable, Mapping
from importlib import resources
from typing import cast

import cantools.database
import msgspec
from cantools.database.can import Database, Message, Signal

from messages.e2e import Profile, Profile2, Profile5
from messages.inputs import AnkleState, GaitPhase

NOT_AVAILABLE = "not_available"
RESERVED = "reserved"
CLASSIC_BYTES = 8


class CanMessage(str, enum.Enum):
    """The messages of the DBC, by their names there."""

    ANKLE_STATE = "ANKLE_STATE"
    GROUND = "GROUND"
    GROUND_QUALITY = "GROUND_QUALITY"
    PROPAGATED_GROUND = "PROPAGATED_GROUND"
    PROPAGATED_GROUND_QUALITY = "PROPAGATED_GROUND_QUALITY"
    FOOTHOLD = "FOOTHOLD"
    FOOTHOLD_QUALITY = "FOOTHOLD_QUALITY"
    TERRAIN = "TERRAIN"
    TERRAIN_QUALITY = "TERRAIN_QUALITY"
    SETPOINT = "SETPOINT"
    SETPOINT_QUALITY = "SETPOINT_QUALITY"
    SETPOINT_FD = "SETPOINT_FD"
    HEALTH = "HEALTH"


POINT_NUMBERS = ("equilibrium_rad", "stiffness_nm_per_rad", "damping_nms_per_rad")
"""The signals of one point in SETPOINT, and the fields of `messages.Setpoint` that they tell."""


def on_point(name: str, percent: int) -> str:
    """Return under which name SETPOINT_FD tells one of the `POINT_NUMBERS` at `percent` of stance."""
    quantity, _, unit = name.partition("_")
    return f"{quantity}_{percent}_{unit}"


class EdgeTold(str, enum.Enum):
    """What TERRAIN tells of the nearest edge ahead."""

    NONE = "none"
    MEASURED = "measured"
    BOUND_ONLY = "bound_only"


class CanFrame(msgspec.Struct, frozen=True):
    """One CAN frame: an 11-bit identifier and its data bytes, more than 8 on a bus of CAN FD alone."""

    can_id: int
    data: bytes

    @property
    def is_fd(self) -> bool:
        """Return whether it takes CAN FD."""
        return len(self.data) > CLASSIC_BYTES


class Fields(msgspec.Struct, frozen=True):
    """A decoded frame: physical numbers (NaN: not available) and words (RESERVED: no word for the raw value)."""

    numbers: dict[str, float]
    words: dict[str, str]


@functools.cache
def database() -> Database:
    """Return the DBC as cantools reads it."""
    text = resources.files("messages").joinpath("gaiteyes.dbc").read_text(encoding="ascii")
    loaded = cantools.database.load_string(text, database_format="dbc")
    if not isinstance(loaded, Database):
        raise TypeError("gaiteyes.dbc is not a CAN database")
    return loaded


@functools.cache
def _message(message: CanMessage) -> Message:
    return database().get_message_by_name(message.value)


@functools.cache
def can_id(message: CanMessage) -> int:
    """Return the identifier under which `message` travels."""
    return _message(message).frame_id


@functools.cache
def profile(message: CanMessage) -> Profile:
    """Return the protection and the cycle of `message` from its DBC attributes."""
    definition = _message(message)
    if definition.dbc is None:
        raise TypeError(f"gaiteyes.dbc: {message.value} has no attributes")
    attributes = definition.dbc.attributes
    max_delta = int(attributes["E2EMaxDeltaCounter"].value)
    cycle_s = 1e-3 * int(attributes["GenMsgCycleTime"].value)
    frames = int(attributes["FramesPerCycle"].value) if "FramesPerCycle" in attributes else 1
    if attributes["E2EProfile"].value == "PROFILE_05":
        return Profile5(
            length=definition.length,
            max_delta=max_delta,
            cycle_s=cycle_s,
            data_id=int(attributes["E2EDataId"].value),
            frames_per_cycle=frames,
        )
    return Profile2(
        length=definition.length,
        max_delta=max_delta,
        cycle_s=cycle_s,
        data_ids=bytes.fromhex(str(attributes["E2EDataIdList"].value)),
        frames_per_cycle=frames,
    )


class Code(msgspec.Struct, frozen=True):
    """How one signal carries a number or a word."""

    start_bit: int
    length_bits: int
    scale: float
    raw_min: int
    raw_max: int
    not_available: int | None
    words: dict[int, str]
    raw_of: dict[str, int]

    def raw(self, value: float, rounded: Callable[[float], int] = round) -> int | None:
        """Return the raw value of `value`, `rounded` to a step, or None if it is NaN or does not fit."""
        steps = value / self.scale
        if not math.isfinite(steps):
            return None
        raw = rounded(steps)
        return raw if self.raw_min <= raw <= self.raw_max else None

    def raw_of_word(self, word: enum.Enum) -> int:
        """Return the raw value whose name is the enum member's value; KeyError if the DBC lacks it."""
        return self.raw_of[word.value]


def up(steps: float) -> int:
    """Round up; a rounding error above a step does not make it the next one."""
    return math.ceil(steps - _ROUNDING_ERROR)


def down(steps: float) -> int:
    """Round down; a rounding error below a step does not make it the one before."""
    return math.floor(steps + _ROUNDING_ERROR)


_ROUNDING_ERROR = 1e-9


def _code(signal: Signal) -> Code:
    choices = {raw: str(name) for raw, name in (signal.choices or {}).items()}
    words = {raw: name for raw, name in choices.items() if name != NOT_AVAILABLE}
    scale, low, high = float(signal.scale), float(signal.minimum or 0), float(signal.maximum or 0)
    return Code(
        signal.start,
        signal.length,
        scale,
        round(low / scale),
        round(high / scale),
        next((raw for raw, name in choices.items() if name == NOT_AVAILABLE), None),
        words,
        {name: raw for raw, name in words.items()},
    )


@functools.cache
def codes(message: CanMessage) -> dict[str, Code]:
    """Return how each signal of `message` carries its value, by the signal's name."""
    return {signal.name: _code(signal) for signal in _message(message).signals}


def packed(message: CanMessage, raws: Mapping[str, int]) -> bytes:
    """Return the frame of `message` with these raw values; signals that are not named are 0. All are little-endian."""
    frame = 0
    for name, raw in raws.items():
        code = codes(message)[name]
        frame |= (raw & (1 << code.length_bits) - 1) << code.start_bit
    return frame.to_bytes(_message(message).length, "little")


def decode(message: CanMessage, data: bytes) -> Fields:
    """Return the signals of a frame whose protection has been checked."""
    # Without scaling and choices cantools returns plain integers; its type covers the other cases too.
    raws = cast(dict[str, int], _message(message).decode(data, scaling=False, decode_choices=False))
    numbers: dict[str, float] = {}
    words: dict[str, str] = {}
    for name, code in codes(message).items():
        raw = raws[name]
        if code.words:
            words[name] = code.words.get(raw, RESERVED)
        else:
            numbers[name] = math.nan if raw == code.not_available else raw * code.scale
    return Fields(numbers, words)


def decode_ankle(data: bytes, t_sample_ns: int) -> AnkleState:
    """Return the ankle's state from an ANKLE_STATE frame whose protection has been checked."""
    fields = decode(CanMessage.ANKLE_STATE, data)
    phase = fields.words["phase"]
    return AnkleState(
        t_sample_ns=t_sample_ns,
        ankle_angle_rad=fields.numbers["ankle_angle_rad"],
        ankle_rate_radps=fields.numbers["ankle_rate_radps"],
        load_n=fields.numbers["load_n"],
        phase=GaitPhase.UNKNOWN if phase == RESERVED else GaitPhase(phase),
    )
