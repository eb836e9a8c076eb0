"""Writes docs/can.md, every frame and the load of the bus, out of messages/gaiteyes.dbc: `python docs/make_can.py`."""

import sys
from pathlib import Path

from cantools.database.can import Message, Signal

from messages.can_frames import NOT_AVAILABLE, database

PAGE = Path(__file__).parent / "can.md"

BITS_PER_S = 500_000
REASONS_IN = "GROUND_QUALITY"
IN_PLACE_OF_FD = ("SETPOINT", "SETPOINT_QUALITY")
CLASSIC_BYTES = 8
HEADER_AND_TAIL_BITS = 44
"""Of a classic frame with an 11-bit identifier: start, identifier, control, CRC, acknowledgement, end (ISO 11898-1)."""
STUFFABLE_HEADER_BITS = 34
"""Of these: from the start to the end of the CRC."""
PAUSE_BITS = 3
FD_HEADER_BITS = 22
"""Of a frame of CAN FD with an 11-bit identifier: from the start to the length (ISO 11898-1:2015)."""
FD_LEAST_OF_CRC_21 = 17
"""So many data bytes, or more, have a CRC of 21 bits and not of 17."""
FD_TAIL_BITS = 10
"""End of the CRC, acknowledgement and its end, end of the frame."""

HEAD = """# On CAN

For whoever connects a controller, or an analyser. `messages/gaiteyes.dbc` is the contract, and this page is made from
it by `python docs/make_can.py`. Load the DBC into the analyser, or make a microcontroller's codec with
`cantools generate_c_source messages/gaiteyes.dbc`; `messages/can_receiver.py` is the reference of what a receiver
checks. Frames, slopes and heights are explained in [architecture](architecture.md#frames-units-time), reasons in
[safety](safety.md).

Each estimate is two frames, which follow each other at once, carry one `frame_number` and are used together or not at
all; the [set-points](setpoints.md) of the ankle, SETPOINT, are six of which each stands for itself, or one of CAN FD:

<!-- not run: needs hardware -->
```python
import gaiteyes

kinds = gaiteyes.ReceivedGround, gaiteyes.ReceivedTerrain
with gaiteyes.listen_can("socketcan:can0", *kinds, timeout_s=0.2) as listener:
    for estimate in listener:  # passed every check
        print(estimate)
```

1. Check length, CRC and counter (AUTOSAR end-to-end profile 2, of SETPOINT_FD profile 5, as the DBC's comments say);
   drop what fails.
2. Drop a first half within a quarter of its cycle after the one before: it waited in a queue and is older than it says.
3. Join a second half with the first half before it, if both carry one `frame_number`.
4. Act only on `status` valid, `source` live, and an age within your limit: `age_ms` and the time since the first half.
5. A number that is `not_available` is not known: never take it for zero. Refuse a pair that lacks a number, unless the
   message says that it may.
6. Without a pair that passes for your time limit, fall back to what you do on unknown ground.

Raw values are what the frame holds; value = raw × resolution. Signals are little-endian; a start bit counts from bit 0
of byte 0.
"""

LOAD_HEAD = """## Load of the bus

Worst case at 500 kbit/s: each frame with as many stuff bits as its bits can need, ⌊(34 + 8n − 1) / 4⌋ for n data bytes,
and the pause after it; the controller's own ANKLE_STATE is counted too. Nothing is sent again and no other node is
counted. The frame of CAN FD, its data at the same bit rate, needs ⌊(22 + 8n − 1) / 4⌋ stuff bits, and before and in its
CRC fixed ones; it is sent in place of SETPOINT and SETPOINT_QUALITY and not beside them.
"""


def page() -> str:
    """Return the page."""
    messages = sorted(database().messages, key=lambda message: message.frame_id)
    return "\n".join([HEAD, *(_described(message) for message in messages), LOAD_HEAD, _load(messages)])


def frame_bits(data_bytes: int) -> int:
    """Return how long a frame keeps the bus at worst, in bits, the pause after it included."""
    if data_bytes > CLASSIC_BYTES:
        head = FD_HEADER_BITS + 8 * data_bytes
        count_and_crc = 4 + (21 if data_bytes >= FD_LEAST_OF_CRC_21 else 17)
        return head + (head - 1) // 4 + count_and_crc + -(-count_and_crc // 4) + FD_TAIL_BITS + PAUSE_BITS
    stuffed = (STUFFABLE_HEADER_BITS + 8 * data_bytes - 1) // 4
    return HEADER_AND_TAIL_BITS + 8 * data_bytes + stuffed + PAUSE_BITS


def _described(message: Message) -> str:
    told = (message.comment or "").replace("\n", " ")
    sent = f"{_rate(message)}, by {message.senders[0]}"
    lines = [
        f"## {message.name}\n",
        f"Identifier 0x{message.frame_id:03X} ({message.frame_id}), {sent}. {told}\n",
        "| signal | bits | range | resolution | not available | what it says |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        _row(message, signal) for signal in message.signals if signal.name not in ("crc", "counter", "frame_number")
    ]
    return "\n".join(lines) + "\n"


def _row(message: Message, signal: Signal) -> str:
    choices = {raw: str(name) for raw, name in (signal.choices or {}).items()}
    missing = [raw for raw, name in choices.items() if name == NOT_AVAILABLE]
    words = ", ".join(f"{raw} {name}" for raw, name in choices.items() if name != NOT_AVAILABLE)
    unit = f" {signal.unit}" if signal.unit else ""
    if signal.name == "reason" and message.name != REASONS_IN:
        words = f"as in {REASONS_IN}"
    spread = words or f"{signal.minimum:g} to {signal.maximum:g}{unit}"
    step = "" if words else f"{signal.scale:g}{unit}"
    told = (signal.comment or "").replace("\n", " ")
    bits = f"{signal.start} to {signal.start + signal.length - 1}"
    return f"| `{signal.name}` | {bits} | {spread} | {step} | {missing[0] if missing else ''} | {told} |"


def _rate(message: Message) -> str:
    return f"{_per_s(message):g} times a second"


def _per_s(message: Message) -> float:
    assert message.dbc is not None
    bursts = message.dbc.attributes.get("FramesPerCycle")
    return (1 if bursts is None else int(bursts.value)) * 1e3 / _cycle_ms(message)


def _cycle_ms(message: Message) -> int:
    assert message.dbc is not None
    return int(message.dbc.attributes["GenMsgCycleTime"].value)


def _load(messages: list[Message]) -> str:
    lines = ["| frame | identifier | a second | bits at worst | load |", "| --- | --- | ---: | ---: | ---: |"]
    shares: dict[str, float] = {}
    for message in messages:
        bits, rate_hz = frame_bits(message.length), _per_s(message)
        shares[message.name] = share = bits * rate_hz / BITS_PER_S
        lines.append(f"| {message.name} | 0x{message.frame_id:03X} | {rate_hz:g} | {bits} | {100 * share:.2f} % |")
    fd = sum(shares[message.name] for message in messages if message.is_fd)
    in_its_place = sum(share for name, share in shares.items() if name in IN_PLACE_OF_FD)
    total = sum(shares.values()) - fd
    lines.append(f"| all of a classic bus | | | | {100 * total:.2f} % |")
    lines.append(f"| all of a bus of CAN FD | | | | {100 * (total - in_its_place + fd):.2f} % |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    made = page()
    if "--check" in sys.argv[1:]:
        is_new = PAGE.exists() and PAGE.read_text(encoding="utf-8") == made
        sys.exit(0 if is_new else f"{PAGE}: out of date; run python docs/make_can.py")
    PAGE.write_text(made, encoding="utf-8")
