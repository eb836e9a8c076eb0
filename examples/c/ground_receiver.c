#include "ground_receiver.h"

#include <string.h>

#include "gaiteyes.h"

/* E2EDataIdList, E2EMaxDeltaCounter and GenMsgCycleTime of both messages in gaiteyes.dbc. */
static const uint8_t DATA_IDS[2][16] = {
    {0x42, 0xB5, 0x81, 0x3A, 0x1B, 0x4F, 0x1E, 0x89, 0xAF, 0x3C, 0x24, 0xC8, 0xC1, 0x31, 0x15, 0x35},
    {0x0C, 0x6E, 0x8C, 0xFA, 0x98, 0x6A, 0x9A, 0xD4, 0xDF, 0xB7, 0xE4, 0xA7, 0xF0, 0x0D, 0xF8, 0x18},
};
enum { MAX_DELTA = 3, CYCLE_NS = 50000000 };
static const int64_t SILENCE_NS = (2 * MAX_DELTA + 1) * (int64_t)CYCLE_NS / 2; /* MAX_DELTA + 0.5 cycles */
static const int64_t MIN_SPACING_NS = CYCLE_NS / 4;

static uint8_t crc8(uint8_t crc, uint8_t byte)
{
    crc ^= byte;
    for (int bit = 0; bit < 8; bit++)
        crc = (uint8_t)(crc & 0x80 ? (crc << 1) ^ 0x2F : crc << 1);
    return crc;
}

/* AUTOSAR end-to-end profile 2: bytes 1 to 7, then the Data ID of this counter, which is not sent. */
static uint8_t frame_crc(const uint8_t *data, const uint8_t *data_ids)
{
    uint8_t crc = 0xFF;
    for (int place = 1; place < 8; place++)
        crc = crc8(crc, data[place]);
    return crc8(crc, data_ids[data[1] & 0x0F]) ^ 0xFF;
}

static enum ground_verdict protection(struct ground_sequence *sequence, const uint8_t *data_ids, const uint8_t *data,
                                      size_t length, int64_t t_ns)
{
    if (length != GAITEYES_GROUND_LENGTH)
        return GROUND_WRONG_LENGTH;
    if (data[0] != frame_crc(data, data_ids))
        return GROUND_WRONG_CRC;
    struct ground_sequence last = *sequence;
    *sequence = (struct ground_sequence){true, data[1] & 0x0F, t_ns};
    if (!last.begun || t_ns - last.t_ns > SILENCE_NS)
        return GROUND_INITIAL;
    uint8_t delta = (uint8_t)(sequence->counter - last.counter) & 0x0F;
    if (delta == 0)
        return GROUND_REPEATED;
    return delta <= MAX_DELTA ? GROUND_OK : GROUND_WRONG_SEQUENCE;
}

static enum ground_verdict pair(const struct ground_receiver *receiver, const uint8_t *second_data, int64_t t_ns,
                                struct ground_estimate *estimate)
{
    struct gaiteyes_ground_t first;
    struct gaiteyes_ground_quality_t second;
    gaiteyes_ground_unpack(&first, receiver->first, GAITEYES_GROUND_LENGTH);
    gaiteyes_ground_quality_unpack(&second, second_data, GAITEYES_GROUND_QUALITY_LENGTH);
    if (first.frame_number != second.frame_number)
        return GROUND_FRAME_MISMATCH;
    bool told = first.source == GAITEYES_GROUND_SOURCE_REPLAY_CHOICE ||
                first.source == GAITEYES_GROUND_SOURCE_SIMULATED_CHOICE;
    if (first.source != GAITEYES_GROUND_SOURCE_LIVE_CHOICE && !(receiver->accept_simulated && told))
        return GROUND_NOT_LIVE;
    if (first.status != GAITEYES_GROUND_STATUS_VALID_CHOICE)
        return GROUND_NOT_VALID;
    double age_at_first_s = 1e-3 * first.age_ms;
    double age_s = age_at_first_s + 1e-9 * (double)(t_ns - receiver->t_first_ns);
    if (first.age_ms == GAITEYES_GROUND_AGE_MS_NOT_AVAILABLE_CHOICE || age_s > receiver->max_age_s)
        return GROUND_STALE;
    if (first.slope_sagittal_rad == GAITEYES_GROUND_SLOPE_SAGITTAL_RAD_NOT_AVAILABLE_CHOICE ||
        first.slope_frontal_rad == GAITEYES_GROUND_SLOPE_FRONTAL_RAD_NOT_AVAILABLE_CHOICE ||
        first.height_m == GAITEYES_GROUND_HEIGHT_M_NOT_AVAILABLE_CHOICE ||
        second.slope_sagittal_sd_rad == GAITEYES_GROUND_QUALITY_SLOPE_SAGITTAL_SD_RAD_NOT_AVAILABLE_CHOICE ||
        second.slope_frontal_sd_rad == GAITEYES_GROUND_QUALITY_SLOPE_FRONTAL_SD_RAD_NOT_AVAILABLE_CHOICE ||
        second.height_sd_m == GAITEYES_GROUND_QUALITY_HEIGHT_SD_M_NOT_AVAILABLE_CHOICE)
        return GROUND_NOT_AVAILABLE;
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
    return GROUND_OK;
}

void ground_receiver_init(struct ground_receiver *receiver, double max_age_s, bool accept_simulated)
{
    *receiver = (struct ground_receiver){.max_age_s = max_age_s, .accept_simulated = accept_simulated};
}

enum ground_verdict ground_receiver_feed(struct ground_receiver *receiver, uint32_t frame_id, const uint8_t *data,
                                         size_t length, int64_t t_ns, struct ground_estimate *estimate)
{
    if (frame_id != GAITEYES_GROUND_FRAME_ID && frame_id != GAITEYES_GROUND_QUALITY_FRAME_ID)
        return GROUND_OTHER_MESSAGE;
    bool is_first = frame_id == GAITEYES_GROUND_FRAME_ID;
    bool too_soon = is_first && receiver->first_heard && t_ns - receiver->t_last_first_ns < MIN_SPACING_NS;
    if (is_first) {
        receiver->first_heard = true;
        receiver->t_last_first_ns = t_ns;
    }
    int which = is_first ? 0 : 1;
    enum ground_verdict found = protection(&receiver->sequences[which], DATA_IDS[which], data, length, t_ns);
    if (found != GROUND_OK)
        return found;
    if (is_first) {
        receiver->has_first = !too_soon;
        receiver->t_first_ns = t_ns;
        memcpy(receiver->first, data, sizeof receiver->first);
        return too_soon ? GROUND_TOO_SOON : GROUND_FIRST_HALF;
    }
    bool has_first = receiver->has_first;
    receiver->has_first = false; /* a half is used once */
    return has_first ? pair(receiver, data, t_ns, estimate) : GROUND_FRAME_MISMATCH;
}

const char *ground_verdict_name(enum ground_verdict verdict)
{
    static const char *const NAMES[] = {
        "ok",       "other_message",  "first_half", "wrong_length",   "wrong_crc", "initial",   "repeated",
        "wrong_sequence", "too_soon", "frame_mismatch", "not_live",  "not_valid", "stale",     "not_available",
    };
    return NAMES[verdict];
}
