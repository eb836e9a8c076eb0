"""Messages as CAN frames and back, after `gaiteyes.dbc`: layout, scales, words, Data IDs and cycle times stand
there alone, so that an analyser, `cantools generate_c_source` and this module read one contract.

A number that is NaN travels as the raw value named `not_available`, never as zero. A number that does not fit its
signal is not clipped: a ground estimate then leaves as INVALID, reason OUT_OF_RANGE, with no numbers at all. Standard
deviations and ages are rounded up, so that a frame never claims more than the estimate did.
"""

import enum
import functools
import math
from collections.abc import Mapping
from importlib import resources
from typing import cast

import cantools.database
import msgspec
from cantools.database.can import Database, Message, Signal

from messages.e2e import E2eSender, Profile2
from messages.estimates import GroundPlane, Health, Stamp
from messages.inputs import AnkleState, GaitPhase
from messages.reasons import Reason, Status

NOT_AVAILABLE = "not_available"
RESERVED = "reserved"
FRAME_NUMBERS = 16
COUNT_MODULUS = 4096

_GROUND_NUMBERS = ("slope_sagittal_rad", "slope_frontal_rad", "height_m")
_DEVIATIONS = ("slope_sagittal_sd_rad", "slope_frontal_sd_rad", "height_sd_m")
_ANKLE_NUMBERS = ("ankle_angle_rad", "ankle_rate_radps", "load_n")


class CanMessage(str, enum.Enum):
    """The messages of the DBC, by their names there."""

    ANKLE_STATE = "ANKLE_STATE"
    GROUND = "GROUND"
    GROUND_QUALITY = "GROUND_QUALITY"
    HEALTH = "HEALTH"


class CanFrame(msgspec.Struct, frozen=True):
    """One classic CAN frame: an 11-bit identifier and its data bytes."""

    can_id: int
    data: bytes


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
def profile(message: CanMessage) -> Profile2:
    """Return the protection and the cycle of `message` from its DBC attributes."""
    definition = _message(message)
    if definition.dbc is None:
        raise TypeError(f"gaiteyes.dbc: {message.value} has no attributes")
    attributes = definition.dbc.attributes
    return Profile2(
        length=definition.length,
        data_ids=bytes.fromhex(str(attributes["E2EDataIdList"].value)),
        max_delta=int(attributes["E2EMaxDeltaCounter"].value),
        cycle_s=1e-3 * int(attributes["GenMsgCycleTime"].value),
    )


class _Code(msgspec.Struct, frozen=True):
    """How one signal carries a number or a word."""

    scale: float
    raw_min: int
    raw_max: int
    not_available: int | None
    words: dict[int, str]

    def raw(self, value: float, *, up: bool = False) -> int | None:
        """Return the raw value of `value`, or None if it is NaN or does not fit."""
        steps = value / self.scale
        if not math.isfinite(steps):
            return None
        # A rounding error above a step does not make it the next one.
        raw = math.ceil(steps - 1e-9) if up else round(steps)
        return raw if self.raw_min <= raw <= self.raw_max else None

    def raw_of_word(self, word: enum.Enum) -> int:
        """Return the raw value whose name is the enum member's value; KeyError if the DBC lacks it."""
        return {name: raw for raw, name in self.words.items()}[word.value]


def _code(signal: Signal) -> _Code:
    choices = {raw: str(name) for raw, name in (signal.choices or {}).items()}
    scale, low, high = float(signal.scale), float(signal.minimum or 0), float(signal.maximum or 0)
    return _Code(
        scale,
        round(low / scale),
        round(high / scale),
        next((raw for raw, name in choices.items() if name == NOT_AVAILABLE), None),
        {raw: name for raw, name in choices.items() if name != NOT_AVAILABLE},
    )


@functools.cache
def _codes(message: CanMessage) -> dict[str, _Code]:
    return {signal.name: _code(signal) for signal in _message(message).signals}


def decode(message: CanMessage, data: bytes) -> Fields:
    """Return the signals of a frame whose protection has been checked."""
    # Without scaling and choices cantools returns plain integers; its type covers the other cases too.
    raws = cast(dict[str, int], _message(message).decode(data, scaling=False, decode_choices=False))
    numbers: dict[str, float] = {}
    words: dict[str, str] = {}
    for name, code in _codes(message).items():
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


class CanEncoder:
    """Makes the frames of every message, each protected and numbered in the order of the calls."""

    def __init__(self) -> None:
        self._senders = {message: E2eSender(profile(message)) for message in CanMessage}

    def ground(self, ground: GroundPlane, stamp: Stamp, age_s: float) -> tuple[CanFrame, CanFrame]:
        """Return GROUND and GROUND_QUALITY of one estimate, to be sent in this order.

        `age_s` runs from mid-exposure to now. Raises ValueError if `calibration_id` is no hexadecimal number.
        """
        first, second = _codes(CanMessage.GROUND), _codes(CanMessage.GROUND_QUALITY)
        values = {name: first[name].raw(getattr(ground, name)) for name in _GROUND_NUMBERS}
        deviations = {
            name: second[name].raw(math.sqrt(variance) if variance >= 0.0 else math.nan, up=True)
            for name, variance in zip(_DEVIATIONS, (ground.covariance[i] for i in (0, 3, 5)), strict=True)
        }
        status, reason = ground.status, ground.reason
        if status is Status.VALID and None in (*values.values(), *deviations.values()):
            status, reason = Status.INVALID, Reason.OUT_OF_RANGE
        valid = status is Status.VALID
        number = stamp.seq % FRAME_NUMBERS
        return (
            self._frame(
                CanMessage.GROUND,
                (values if valid else dict.fromkeys(values))
                | {
                    "frame_number": number,
                    "status": first["status"].raw_of_word(status),
                    "source": first["source"].raw_of_word(stamp.source),
                    "age_ms": _age_ms(first["age_ms"], age_s),
                },
            ),
            self._frame(
                CanMessage.GROUND_QUALITY,
                (deviations if valid else dict.fromkeys(deviations))
                | {
                    "frame_number": number,
                    "reason": second["reason"].raw_of_word(reason),
                    "calibration_id": int(ground.calibration_id[:3], 16),
                },
            ),
        )

    def health(self, health: Health, stamp: Stamp) -> CanFrame:
        """Return HEALTH: counts since the start, modulo 4096."""
        codes = _codes(CanMessage.HEALTH)
        counts = {
            "imu_lost": health.imu_lost,
            "imu_bus_errors": health.imu_bus_errors,
            "frames_dropped": sum(health.frames_dropped.values()),
            "frames_refused": sum(health.refused.values()),
        }
        return self._frame(
            CanMessage.HEALTH,
            {name: count % COUNT_MODULUS for name, count in counts.items()}
            | {
                "source": codes["source"].raw_of_word(stamp.source),
                "load": codes["load"].raw_of_word(health.load),
            },
        )

    def ankle(self, state: AnkleState) -> CanFrame:
        """Return ANKLE_STATE as the controller of an ankle sends it; a number that does not fit is not available."""
        codes = _codes(CanMessage.ANKLE_STATE)
        numbers = {name: codes[name].raw(getattr(state, name)) for name in _ANKLE_NUMBERS}
        return self._frame(CanMessage.ANKLE_STATE, numbers | {"phase": codes["phase"].raw_of_word(state.phase)})

    def _frame(self, message: CanMessage, raws: Mapping[str, int | None]) -> CanFrame:
        codes = _codes(message)
        present = {
            name: value
            for name, raw in raws.items()
            if (value := codes[name].not_available if raw is None else raw) is not None
        }
        payload = _message(message).encode(present | {"crc": 0, "counter": 0}, scaling=False, strict=False)
        return CanFrame(can_id(message), self._senders[message].protect(payload))


def _age_ms(code: _Code, age_s: float) -> int | None:
    """An age saturates at the signal's end, which means 'this old or older'; an impossible one is not available."""
    return code.raw(min(1e3 * age_s, code.raw_max * code.scale), up=True)
