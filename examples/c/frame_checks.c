#include "frame_checks.h"

#include "gaiteyes.h"

enum { LENGTH_2 = 8, LAST_COUNTER_2 = 0x0F, LAST_COUNTER_5 = 0xFF };

static uint8_t crc8(uint8_t crc, uint8_t byte)
{
    crc ^= byte;
    for (int bit = 0; bit < 8; bit++)
        crc = (uint8_t)(crc & 0x80 ? (crc << 1) ^ 0x2F : crc << 1);
    return crc;
}

static uint16_t crc16(uint16_t crc, uint8_t byte)
{
    crc = (uint16_t)(crc ^ byte << 8);
    for (int bit = 0; bit < 8; bit++)
        crc = (uint16_t)(crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1);
    return crc;
}

/* Bytes 1 to 7, then the Data ID of this counter, which is not sent. */
static uint8_t crc_2(const uint8_t *data, const uint8_t *data_ids)
{
    uint8_t crc = 0xFF;
    for (int place = 1; place < LENGTH_2; place++)
        crc = crc8(crc, data[place]);
    return crc8(crc, data_ids[data[1] & LAST_COUNTER_2]) ^ 0xFF;
}

/* From byte 2 on, then the Data ID, low byte first, which is not sent. */
static uint16_t crc_5(const uint8_t *data, size_t length, uint16_t data_id)
{
    uint16_t crc = 0xFFFF;
    for (size_t place = 2; place < length; place++)
        crc = crc16(crc, data[place]);
    return crc16(crc16(crc, (uint8_t)(data_id & 0xFF)), (uint8_t)(data_id >> 8));
}

/* Counters run from 0 to last_counter, a power of two less one. */
static enum frame_verdict order(struct frame_sequence *sequence, uint8_t counter, uint8_t last_counter,
                                int64_t silence_ns, int64_t t_ns)
{
    struct frame_sequence last = *sequence;
    *sequence = (struct frame_sequence){true, counter, t_ns};
    if (!last.begun || t_ns - last.t_ns > silence_ns)
        return FRAME_INITIAL;
    uint8_t delta = (uint8_t)(counter - last.counter) & last_counter;
    if (delta == 0)
        return FRAME_REPEATED;
    return delta <= FRAME_MAX_DELTA ? FRAME_OK : FRAME_WRONG_SEQUENCE;
}

enum frame_verdict frame_check_2(struct frame_sequence *sequence, const uint8_t *data_ids, const uint8_t *data,
                                 size_t length, int64_t silence_ns, int64_t t_ns)
{
    if (length != LENGTH_2)
        return FRAME_WRONG_LENGTH;
    if (data[0] != crc_2(data, data_ids))
        return FRAME_WRONG_CRC;
    return order(sequence, data[1] & LAST_COUNTER_2, LAST_COUNTER_2, silence_ns, t_ns);
}

enum frame_verdict frame_check_5(struct frame_sequence *sequence, uint16_t data_id, const uint8_t *data, size_t length,
                                 size_t expected, int64_t t_ns)
{
    if (length != expected)
        return FRAME_WRONG_LENGTH;
    if ((data[0] | data[1] << 8) != crc_5(data, length, data_id))
        return FRAME_WRONG_CRC;
    return order(sequence, data[2], LAST_COUNTER_5, FRAME_SILENCE_NS, t_ns);
}

bool frame_too_soon(struct frame_arrival *last, int64_t t_ns)
{
    bool too_soon = last->heard && t_ns - last->t_ns < FRAME_CYCLE_NS / 4;
    *last = (struct frame_arrival){true, t_ns};
    return too_soon;
}

bool frame_source_counts(uint8_t source, bool accept_simulated)
{
    switch (source) { /* the same numbers in every message */
    case GAITEYES_GROUND_SOURCE_LIVE_CHOICE:
        return true;
    case GAITEYES_GROUND_SOURCE_REPLAY_CHOICE:
    case GAITEYES_GROUND_SOURCE_SIMULATED_CHOICE:
        return accept_simulated;
    default:
        return false;
    }
}

const char *frame_verdict_name(enum frame_verdict verdict)
{
    static const char *const NAMES[] = {
        "ok",       "other_message",  "first_half", "wrong_length",   "wrong_crc", "initial",   "repeated",
        "wrong_sequence", "too_soon", "frame_mismatch", "not_live",  "not_valid", "stale",     "not_available",
    };
    return NAMES[verdict];
}
