#include "ground_receiver.h"

#include <string.h>

#include "gaiteyes.h"

/* E2EDataIdList of both messages in gaiteyes.dbc. */
static const uint8_t DATA_IDS[2][16] = {
    {0x42, 0xB5, 0x81, 0x3A, 0x1B, 0x4F, 0x1E, 0x89, 0xAF, 0x3C, 0x24, 0xC8, 0xC1, 0x31, 0x15, 0x35},
    {0x0C, 0x6E, 0x8C, 0xFA, 0x98, 0x6A, 0x9A, 0xD4, 0xDF, 0xB7, 0xE4, 0xA7, 0xF0, 0x0D, 0xF8, 0x18},
};

static enum frame_verdict pair(const struct ground_receiver *receiver, const uint8_t *second_data, int64_t t_ns,
                               struct ground_estimate *estimate)
{
    struct gaiteyes_ground_t first;
    struct gaiteyes_ground_quality_t second;
    gaiteyes_ground_unpack(&first, receiver->first, GAITEYES_GROUND_LENGTH);
    gaiteyes_ground_quality_unpack(&second, second_data, GAITEYES_GROUND_QUALITY_LENGTH);
    if (first.frame_number != second.frame_number)
        return FRAME_MISMATCH;
    if (!frame_source_counts(first.source, receiver->accept_simulated))
        return FRAME_NOT_LIVE;
    if (first.status != GAITEYES_GROUND_STATUS_VALID_CHOICE)
        return FRAME_NOT_VALID;
    double age_at_first_s = 1e-3 * first.age_ms;
    double age_s = age_at_first_s + 1e-9 * (double)(t_ns - receiver->t_first_ns);
    if (first.age_ms == GAITEYES_GROUND_AGE_MS_NOT_AVAILABLE_CHOICE || age_s > receiver->max_age_s)
        return FRAME_STALE;
    if (first.slope_sagittal_rad == GAITEYES_GROUND_SLOPE_SAGITTAL_RAD_NOT_AVAILABLE_CHOICE ||
        first.slope_frontal_rad == GAITEYES_GROUND_SLOPE_FRONTAL_RAD_NOT_AVAILABLE_CHOICE ||
        first.height_m == GAITEYES_GROUND_HEIGHT_M_NOT_AVAILABLE_CHOICE ||
        second.slope_sagittal_sd_rad == GAITEYES_GROUND_QUALITY_SLOPE_SAGITTAL_SD_RAD_NOT_AVAILABLE_CHOICE ||
        second.slope_frontal_sd_rad == GAITEYES_GROUND_QUALITY_SLOPE_FRONTAL_SD_RAD_NOT_AVAILABLE_CHOICE ||
        second.height_sd_m == GAITEYES_GROUND_QUALITY_HEIGHT_SD_M_NOT_AVAILABLE_CHOICE)
        return FRAME_NOT_AVAILABLE;
    *estimate = (struct ground_estimate){
        .t_exposure_ns = receiver->t_first_ns - (int64_t)first.age_ms * 1000000,
        .age_s = age_s,
        .slope_sagittal_rad = gaiteyes_ground_slope_sagittal_rad_decode(first.slope_sagittal_rad),
        .slope_frontal_rad = gaiteyes_ground_slope_frontal_rad_decode(first.slope_frontal_rad),
        .height_m = gaiteyes_ground_height_m_decode(first.height_m),
        .slope_sagittal_sd_rad = gaiteyes_ground_quality_slope_sagittal_sd_rad_decode(second.slope_sagittal_sd_rad),
        .slope_frontal_sd_rad = gaiteyes_ground_quality_slope_frontal_sd_rad_decode(second.slope_frontal_sd_rad),
        .height_sd_m = gaiteyes_ground_quality_height_sd_m_decode(second.height_sd_m),
        .calibration_id = second.calibration_id,
    };
    return FRAME_OK;
}

void ground_receiver_init(struct ground_receiver *receiver, double max_age_s, bool accept_simulated)
{
    *receiver = (struct ground_receiver){.max_age_s = max_age_s, .accept_simulated = accept_simulated};
}

enum frame_verdict ground_receiver_feed(struct ground_receiver *receiver, uint32_t frame_id, const uint8_t *data,
                                        size_t length, int64_t t_ns, struct ground_estimate *estimate)
{
    if (frame_id != GAITEYES_GROUND_FRAME_ID && frame_id != GAITEYES_GROUND_QUALITY_FRAME_ID)
        return FRAME_OTHER_MESSAGE;
    bool is_first = frame_id == GAITEYES_GROUND_FRAME_ID;
    bool too_soon = is_first && frame_too_soon(&receiver->last_first, t_ns);
    int which = is_first ? 0 : 1;
    enum frame_verdict found =
        frame_check_2(&receiver->sequences[which], DATA_IDS[which], data, length, FRAME_SILENCE_NS, t_ns);
    if (found != FRAME_OK)
        return found;
    if (is_first) {
        receiver->has_first = !too_soon;
        receiver->t_first_ns = t_ns;
        memcpy(receiver->first, data, sizeof receiver->first);
        return too_soon ? FRAME_TOO_SOON : FRAME_FIRST_HALF;
    }
    bool has_first = receiver->has_first;
    receiver->has_first = false; /* a half is used once */
    return has_first ? pair(receiver, data, t_ns, estimate) : FRAME_MISMATCH;
}
