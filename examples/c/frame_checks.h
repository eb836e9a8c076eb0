/* What is checked alike of every frame: length, CRC, counter, silence, spacing and source, as docs/can.md says.
 *
 * C99, no allocation, no clock and no bus of its own. The receivers of ground and set-point stand on it.
 */
#ifndef FRAME_CHECKS_H
#define FRAME_CHECKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum frame_verdict {
    FRAME_OK, /* what was told may be acted upon; everything below may not */
    FRAME_OTHER_MESSAGE,
    FRAME_FIRST_HALF, /* the frame that completes it has yet to come */
    FRAME_WRONG_LENGTH,
    FRAME_WRONG_CRC,
    FRAME_INITIAL, /* the first frame, or the first after a silence: its order cannot be judged */
    FRAME_REPEATED,
    FRAME_WRONG_SEQUENCE,
    FRAME_TOO_SOON, /* it waited in a queue and is older than it says */
    FRAME_MISMATCH, /* the halves are of two pictures */
    FRAME_NOT_LIVE,
    FRAME_NOT_VALID,
    FRAME_STALE,
    FRAME_NOT_AVAILABLE
};

/* GenMsgCycleTime and E2EMaxDeltaCounter of the messages in gaiteyes.dbc, and 3 + 0.5 cycles. */
enum { FRAME_CYCLE_NS = 50000000, FRAME_MAX_DELTA = 3, FRAME_SILENCE_NS = 175000000 };

struct frame_sequence { /* of one message */
    bool begun;
    uint8_t counter;
    int64_t t_ns;
};

struct frame_arrival { /* of what comes once a cycle */
    bool heard;
    int64_t t_ns;
};

/* Check AUTOSAR end-to-end profile 2, of 8 bytes; nothing heard for longer than silence_ns begins a new sequence. */
enum frame_verdict frame_check_2(struct frame_sequence *sequence, const uint8_t *data_ids, const uint8_t *data,
                                 size_t length, int64_t silence_ns, int64_t t_ns);

/* Check profile 5, of `expected` bytes. */
enum frame_verdict frame_check_5(struct frame_sequence *sequence, uint16_t data_id, const uint8_t *data, size_t length,
                                 size_t expected, int64_t t_ns);

/* Say whether less than a quarter of a cycle has passed since the last one, and note this one. */
bool frame_too_soon(struct frame_arrival *last, int64_t t_ns);

/* Say whether the source is live, or one that the receiver accepts beside. */
bool frame_source_counts(uint8_t source, bool accept_simulated);

const char *frame_verdict_name(enum frame_verdict verdict);

#endif
