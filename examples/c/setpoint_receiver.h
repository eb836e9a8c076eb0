/* What a controller must check before it acts on SETPOINT and SETPOINT_QUALITY: docs/setpoints.md.
 *
 * C99, no allocation, no clock and no bus of its own: hand each received frame in with the time of its reception.
 * The frames' layout is gaiteyes.h, made from messages/gaiteyes.dbc by `python -m cantools generate_c_source`.
 */
#ifndef SETPOINT_RECEIVER_H
#define SETPOINT_RECEIVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SETPOINT_POINTS = 5 }; /* at 0, 25, 50, 75 and 100 % of stance */

/* SI units, dorsiflexion positive; t_exposure_ns is on the receiver's own clock, of the oldest point. */
struct setpoint_update {
    int64_t t_exposure_ns;
    double age_s;
    uint8_t phase; /* of the foot: 0 unknown, 1 stance, 2 swing */
    double slope_rad, slope_sd_rad;
    double equilibrium_rad[SETPOINT_POINTS], stiffness_nm_per_rad[SETPOINT_POINTS], damping_nms_per_rad[SETPOINT_POINTS];
    double equilibrium_sd_rad, stiffness_sd_share, damping_sd_share; /* the largest over stance */
};

enum setpoint_verdict {
    SETPOINT_OK, /* the update may be acted upon; everything below may not */
    SETPOINT_OTHER_MESSAGE,
    SETPOINT_FIRST_HALF, /* a point; SETPOINT_QUALITY has yet to come */
    SETPOINT_WRONG_LENGTH,
    SETPOINT_WRONG_CRC,
    SETPOINT_INITIAL, /* the first frame, or the first after a silence: its order cannot be judged */
    SETPOINT_REPEATED,
    SETPOINT_WRONG_SEQUENCE,
    SETPOINT_TOO_SOON, /* it waited in a queue and is older than it says */
    SETPOINT_NOT_LIVE,
    SETPOINT_NOT_VALID,
    SETPOINT_STALE,
    SETPOINT_NOT_AVAILABLE
};

struct setpoint_sequence { /* of one message */
    bool begun;
    uint8_t counter;
    int64_t t_ns;
};

struct setpoint_point {
    bool told;
    int64_t t_exposure_ns;
    double equilibrium_rad, stiffness_nm_per_rad, damping_nms_per_rad;
};

struct setpoint_receiver {
    double max_age_s; /* more than 0 and less than 0.254; 0.15 suits walking */
    bool accept_simulated;
    struct setpoint_sequence sequences[3];
    bool heard[3][SETPOINT_POINTS + 3];
    int64_t t_heard_ns[3][SETPOINT_POINTS + 3];
    struct setpoint_point points[SETPOINT_POINTS];
};

void setpoint_receiver_init(struct setpoint_receiver *receiver, double max_age_s, bool accept_simulated);

/* Take one frame received at t_ns; fill `update` where SETPOINT_OK is returned. */
enum setpoint_verdict setpoint_receiver_feed(struct setpoint_receiver *receiver, uint32_t frame_id, const uint8_t *data,
                                             size_t length, int64_t t_ns, struct setpoint_update *update);

const char *setpoint_verdict_name(enum setpoint_verdict verdict);

#endif
