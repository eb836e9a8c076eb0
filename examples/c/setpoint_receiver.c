#include "setpoint_receiver.h"

#include <string.h>

#include "gaiteyes.h"

enum { POINT = 0, QUALITY = 1, FD = 2 };

/* Of the points 3 + 0.5 cycles are too long: 16 counters are gone in 1.6 cycles. */
enum { POINT_SILENCE_NS = 3 * FRAME_CYCLE_NS / 2 };

/* E2EDataIdList and E2EDataId of the messages in gaiteyes.dbc. */
static const uint8_t DATA_IDS[2][16] = {
    {0xEA, 0x00, 0x87, 0xB6, 0xA3, 0xB9, 0xD9, 0xC9, 0x36, 0x65, 0xE1, 0x8A, 0x5E, 0x03, 0xD1, 0x66},
    {0x4B, 0x09, 0xE8, 0xE6, 0x55, 0xCC, 0x7A, 0x27, 0x17, 0xC2, 0x4E, 0x8E, 0xCB, 0x3B, 0x75, 0xBE},
};
static const uint16_t DATA_ID_FD = 41901;

static enum frame_verdict protection(struct frame_sequence *sequence, int which, const uint8_t *data, size_t length,
                                     int64_t t_ns)
{
    if (which == FD)
        return frame_check_5(sequence, DATA_ID_FD, data, length, GAITEYES_SETPOINT_FD_LENGTH, t_ns);
    int64_t silence_ns = which == POINT ? POINT_SILENCE_NS : FRAME_SILENCE_NS;
    return frame_check_2(sequence, DATA_IDS[which], data, length, silence_ns, t_ns);
}

static void forget(struct setpoint_receiver *receiver) { memset(receiver->points, 0, sizeof receiver->points); }

/* What holds for a frame before its points count. */
static enum frame_verdict admitted(struct setpoint_receiver *receiver, uint8_t source, uint8_t status, uint8_t age_ms)
{
    bool counts = frame_source_counts(source, receiver->accept_simulated);
    if (!counts || status != GAITEYES_SETPOINT_STATUS_VALID_CHOICE) {
        forget(receiver);
        return counts ? FRAME_NOT_VALID : FRAME_NOT_LIVE;
    }
    if (age_ms == GAITEYES_SETPOINT_AGE_MS_NOT_AVAILABLE_CHOICE || age_ms > 1e3 * receiver->max_age_s)
        return FRAME_STALE;
    return FRAME_OK;
}

static enum frame_verdict keep(struct setpoint_point *point, int64_t t_exposure_ns, int16_t equilibrium,
                               uint16_t stiffness, uint16_t damping)
{
    *point = (struct setpoint_point){
        .told = equilibrium != GAITEYES_SETPOINT_EQUILIBRIUM_RAD_NOT_AVAILABLE_CHOICE &&
                stiffness != GAITEYES_SETPOINT_STIFFNESS_NM_PER_RAD_NOT_AVAILABLE_CHOICE &&
                damping != GAITEYES_SETPOINT_DAMPING_NMS_PER_RAD_NOT_AVAILABLE_CHOICE,
        .t_exposure_ns = t_exposure_ns,
        .equilibrium_rad = gaiteyes_setpoint_equilibrium_rad_decode(equilibrium),
        .stiffness_nm_per_rad = gaiteyes_setpoint_stiffness_nm_per_rad_decode(stiffness),
        .damping_nms_per_rad = gaiteyes_setpoint_damping_nms_per_rad_decode(damping),
    };
    return point->told ? FRAME_FIRST_HALF : FRAME_NOT_AVAILABLE;
}

static enum frame_verdict take_point(struct setpoint_receiver *receiver, const struct gaiteyes_setpoint_t *told,
                                     int64_t t_ns)
{
    enum frame_verdict found = admitted(receiver, told->source, told->status, told->age_ms);
    if (found != FRAME_OK)
        return found;
    if (told->stance_percent >= SETPOINT_POINTS) /* raw: steps of 25 % */
        return FRAME_NOT_AVAILABLE;
    return keep(&receiver->points[told->stance_percent], t_ns - (int64_t)told->age_ms * 1000000, told->equilibrium_rad,
                told->stiffness_nm_per_rad, told->damping_nms_per_rad);
}

static enum frame_verdict take_fd(struct setpoint_receiver *receiver, const struct gaiteyes_setpoint_fd_t *told,
                                  int64_t t_ns)
{
    forget(receiver);
    enum frame_verdict found = admitted(receiver, told->source, told->status, told->age_ms);
    if (found != FRAME_OK)
        return found;
    const int16_t equilibrium[] = {told->equilibrium_0_rad, told->equilibrium_25_rad, told->equilibrium_50_rad,
                                   told->equilibrium_75_rad, told->equilibrium_100_rad};
    const uint16_t stiffness[] = {told->stiffness_0_nm_per_rad, told->stiffness_25_nm_per_rad,
                                  told->stiffness_50_nm_per_rad, told->stiffness_75_nm_per_rad,
                                  told->stiffness_100_nm_per_rad};
    const uint16_t damping[] = {told->damping_0_nms_per_rad, told->damping_25_nms_per_rad, told->damping_50_nms_per_rad,
                                told->damping_75_nms_per_rad, told->damping_100_nms_per_rad};
    for (int k = 0; k < SETPOINT_POINTS; k++) {
        found = keep(&receiver->points[k], t_ns - (int64_t)told->age_ms * 1000000, equilibrium[k], stiffness[k],
                     damping[k]);
        if (found != FRAME_FIRST_HALF)
            return found;
    }
    return FRAME_FIRST_HALF;
}

static enum frame_verdict complete(struct setpoint_receiver *receiver, const struct gaiteyes_setpoint_quality_t *told,
                                   int64_t t_ns, struct setpoint_update *update)
{
    if (told->reason != GAITEYES_SETPOINT_QUALITY_REASON_NONE_CHOICE) {
        forget(receiver);
        return FRAME_NOT_VALID;
    }
    bool lacks = told->phase > GAITEYES_SETPOINT_QUALITY_PHASE_SWING_CHOICE ||
                 told->slope_rad == GAITEYES_SETPOINT_QUALITY_SLOPE_RAD_NOT_AVAILABLE_CHOICE ||
                 told->slope_sd_rad == GAITEYES_SETPOINT_QUALITY_SLOPE_SD_RAD_NOT_AVAILABLE_CHOICE ||
                 told->equilibrium_sd_rad == GAITEYES_SETPOINT_QUALITY_EQUILIBRIUM_SD_RAD_NOT_AVAILABLE_CHOICE ||
                 told->stiffness_sd_share == GAITEYES_SETPOINT_QUALITY_STIFFNESS_SD_SHARE_NOT_AVAILABLE_CHOICE ||
                 told->damping_sd_share == GAITEYES_SETPOINT_QUALITY_DAMPING_SD_SHARE_NOT_AVAILABLE_CHOICE;
    int64_t oldest_ns = INT64_MAX;
    for (int k = 0; k < SETPOINT_POINTS; k++) {
        const struct setpoint_point *point = &receiver->points[k];
        lacks = lacks || !point->told;
        if (point->t_exposure_ns < oldest_ns)
            oldest_ns = point->t_exposure_ns;
    }
    if (lacks)
        return FRAME_NOT_AVAILABLE;
    double age_s = 1e-9 * (double)(t_ns - oldest_ns);
    if (age_s > receiver->max_age_s)
        return FRAME_STALE;
    *update = (struct setpoint_update){
        .t_exposure_ns = oldest_ns,
        .age_s = age_s,
        .phase = told->phase,
        .slope_rad = gaiteyes_setpoint_quality_slope_rad_decode(told->slope_rad),
        .slope_sd_rad = gaiteyes_setpoint_quality_slope_sd_rad_decode(told->slope_sd_rad),
        .equilibrium_sd_rad = gaiteyes_setpoint_quality_equilibrium_sd_rad_decode(told->equilibrium_sd_rad),
        .stiffness_sd_share = gaiteyes_setpoint_quality_stiffness_sd_share_decode(told->stiffness_sd_share),
        .damping_sd_share = gaiteyes_setpoint_quality_damping_sd_share_decode(told->damping_sd_share),
    };
    for (int k = 0; k < SETPOINT_POINTS; k++) {
        update->equilibrium_rad[k] = receiver->points[k].equilibrium_rad;
        update->stiffness_nm_per_rad[k] = receiver->points[k].stiffness_nm_per_rad;
        update->damping_nms_per_rad[k] = receiver->points[k].damping_nms_per_rad;
    }
    return FRAME_OK;
}

void setpoint_receiver_init(struct setpoint_receiver *receiver, double max_age_s, bool accept_simulated)
{
    *receiver = (struct setpoint_receiver){.max_age_s = max_age_s, .accept_simulated = accept_simulated};
}

enum frame_verdict setpoint_receiver_feed(struct setpoint_receiver *receiver, uint32_t frame_id, const uint8_t *data,
                                          size_t length, int64_t t_ns, struct setpoint_update *update)
{
    static const uint32_t IDS[] = {GAITEYES_SETPOINT_FRAME_ID, GAITEYES_SETPOINT_QUALITY_FRAME_ID,
                                   GAITEYES_SETPOINT_FD_FRAME_ID};
    int which = POINT;
    while (which <= FD && IDS[which] != frame_id)
        which++;
    if (which > FD)
        return FRAME_OTHER_MESSAGE;
    enum frame_verdict found = protection(&receiver->sequences[which], which, data, length, t_ns);
    if (found == FRAME_INITIAL)
        forget(receiver);
    if (found != FRAME_OK)
        return found;
    struct gaiteyes_setpoint_t point = {0};
    struct gaiteyes_setpoint_fd_t fd = {0};
    struct gaiteyes_setpoint_quality_t quality = {0};
    if (which == POINT)
        gaiteyes_setpoint_unpack(&point, data, length);
    if (frame_too_soon(&receiver->last[which][point.stance_percent], t_ns))
        return FRAME_TOO_SOON;
    if (which == POINT)
        return take_point(receiver, &point, t_ns);
    if (which == QUALITY)
        gaiteyes_setpoint_quality_unpack(&quality, data, length);
    else {
        gaiteyes_setpoint_fd_unpack(&fd, data, length);
        found = take_fd(receiver, &fd, t_ns);
        if (found != FRAME_FIRST_HALF)
            return found;
        quality = (struct gaiteyes_setpoint_quality_t){
            .reason = fd.reason,
            .phase = fd.phase,
            .slope_rad = fd.slope_rad,
            .slope_sd_rad = fd.slope_sd_rad,
            .equilibrium_sd_rad = fd.equilibrium_sd_rad,
            .stiffness_sd_share = fd.stiffness_sd_share,
            .damping_sd_share = fd.damping_sd_share,
        };
    }
    return complete(receiver, &quality, t_ns, update);
}
