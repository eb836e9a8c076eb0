/* What a controller must check before it acts on GROUND and GROUND_QUALITY: docs/listening.md.
 *
 * C99, no allocation, no clock and no bus of its own: hand each received frame in with the time of its reception.
 * The frames' layout is gaiteyes.h, made from messages/gaiteyes.dbc by `python -m cantools generate_c_source`.
 */
#ifndef GROUND_RECEIVER_H
#define GROUND_RECEIVER_H

#include "frame_checks.h"

/* SI units, in the heading frame H; t_exposure_ns is on the receiver's own clock. `_sd` is one standard deviation. */
struct ground_estimate {
    int64_t t_exposure_ns;
    double age_s;
    double slope_sagittal_rad, slope_frontal_rad, height_m;
    double slope_sagittal_sd_rad, slope_frontal_sd_rad, height_sd_m;
    uint16_t calibration_id; /* the first three hexadecimal digits of the calibration in use */
};

struct ground_receiver {
    double max_age_s; /* more than 0 and less than 0.254; 0.1 suits walking */
    bool accept_simulated;
    struct frame_sequence sequences[2];
    struct frame_arrival last_first;
    bool has_first;
    int64_t t_first_ns;
    uint8_t first[8];
};

void ground_receiver_init(struct ground_receiver *receiver, double max_age_s, bool accept_simulated);

/* Take one frame received at t_ns; fill `estimate` where FRAME_OK is returned. */
enum frame_verdict ground_receiver_feed(struct ground_receiver *receiver, uint32_t frame_id, const uint8_t *data,
                                        size_t length, int64_t t_ns, struct ground_estimate *estimate);

#endif
