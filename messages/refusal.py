"""Why a receiver refuses what it is sent: the same words on every transport."""

import enum


class Refusal(str, enum.Enum):
    """Why a message, or a pair of CAN frames, gives nothing to act on."""

    # on every transport
    REPEATED = "repeated"  # the counter stood still
    WRONG_SEQUENCE = "wrong_sequence"  # the counter jumped; where numbers may go missing, it went back
    NOT_LIVE = "not_live"  # replayed or simulated
    NOT_AVAILABLE = "not_available"  # called valid, but a number is missing or impossible
    STALE = "stale"  # older than the limit, or of unknown age

    # on CAN
    OTHER_MESSAGE = "other_message"  # not one of the frames that are listened to
    FIRST_HALF = "first_half"  # of two; the second has yet to come
    WRONG_LENGTH = "wrong_length"
    WRONG_CRC = "wrong_crc"
    INITIAL = "initial"  # the first frame of this message, or the first after a silence: no sequence yet
    TOO_SOON = "too_soon"  # on the heels of another: it waited in a queue, so its age is not to be believed
    FRAME_MISMATCH = "frame_mismatch"  # the halves belong to different estimates, or the first one is missing
    NOT_VALID = "not_valid"  # `CanReceiver.reason` tells why

    # as JSON
    MALFORMED = "malformed"  # no JSON, too long, a field is missing, of a wrong type or out of range
    OTHER_TOPIC = "other_topic"  # another topic's or another device's message under this key
    WRONG_CLOCK = "wrong_clock"  # published, by the clock that both share, later than it arrived
    OTHER_BOOT = "other_boot"  # another boot while the one listened to still publishes, or another on this machine
