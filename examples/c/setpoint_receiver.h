/* What a controller must check before it acts on SETPOINT and SETPOINT_QUALITY: docs/setpoints.md.
 *
 * C99, no allocation, no clock and no bus of its own: hand each received frame in with the time of its reception.
 * The frames' layout is gaiteyes.h, made from messages/gaiteyes.dbc by `python -m cantools generate_c_source`.
 */
#ifndef SETPOINT_RECEIVER_H
#define SETPOINT_RECEIVER_H

#include "frame_checks.h"

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

struct setpoint_point {
    bool told;
    int64_t t_exposure_ns;
    double equilibrium_rad, stiffness_nm_per_rad, damping_nms_per_rad;
};

struct setpoint_receiver {
    double max_age_s; /* more than 0 and less than 0.254; 0.15 suits walking */
    bool accept_simulated;
    struct frame_sequence sequences[3];
    struct frame_arrival last[3][SETPOINT_POINTS + 3]; /* room for all that three bits can count */
    struct setpoint_point points[SETPOINT_POINTS];
};

void setpoint_receiver_init(struct setpoint_receiver *receiver, double max_age_s, bool accept_simulated);

/* Take one frame received at t_ns; fill `update` where FRAME_OK is returned. */
enum frame_verdict setpoint_receiver_feed(struct setpoint_receiver *receiver, uint32_t frame_id, const uint8_t *data,
                                          size_t length, int64_t t_ns, struct setpoint_update *update);

#endif
