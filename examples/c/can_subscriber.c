/* Prints the ground as GaitEyes sends it on CAN, or why a frame may not be acted upon.
 *
 *     can_subscriber can0                       a SocketCAN interface of this machine
 *     can_subscriber - < frames.log             what `candump -L can0` wrote
 *     can_subscriber can0 --accept-simulated    replays and simulations too: never with a person on the ankle
 */
#include <errno.h>
#include <inttypes.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "ground_receiver.h"

enum { PASSED_WITHOUT = 200 /* ms: no ground for so long means no knowledge of the ground */ };

static void tell(struct ground_receiver *receiver, uint32_t frame_id, const uint8_t *data, size_t length, int64_t t_ns)
{
    struct ground_estimate ground;
    enum ground_verdict found = ground_receiver_feed(receiver, frame_id, data, length, t_ns, &ground);
    if (found == GROUND_OK)
        printf("ground %+.4f %+.4f rad %.3f m sd %.4f %.4f %.4f age %.6f s calibration %03x\n",
               ground.slope_sagittal_rad, ground.slope_frontal_rad, ground.height_m, ground.slope_sagittal_sd_rad,
               ground.slope_frontal_sd_rad, ground.height_sd_m, ground.age_s, ground.calibration_id);
    else if (found != GROUND_FIRST_HALF && found != GROUND_OTHER_MESSAGE)
        printf("refused %s\n", ground_verdict_name(found));
    fflush(stdout);
}

static int read_log(struct ground_receiver *receiver)
{
    char line[256], hex[64];
    int64_t seconds, microseconds;
    uint32_t frame_id;
    while (fgets(line, sizeof line, stdin)) {
        hex[0] = '\0';
        if (sscanf(line, "(%" SCNd64 ".%" SCNd64 ") %*s %" SCNx32 "#%63[0-9A-Fa-f]", &seconds, &microseconds, &frame_id,
                   hex) < 3) {
            fprintf(stderr, "not a line of candump -L: %s", line);
            return 2;
        }
        uint8_t data[64];
        size_t length = strlen(hex) / 2;
        for (size_t place = 0; place < length; place++)
            sscanf(hex + 2 * place, "%2hhx", &data[place]);
        tell(receiver, frame_id, data, length, seconds * 1000000000 + microseconds * 1000);
    }
    return 0;
}

static int listen_on(struct ground_receiver *receiver, const char *name)
{
    int link = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    struct ifreq interface = {0};
    strncpy(interface.ifr_name, name, sizeof interface.ifr_name - 1);
    struct sockaddr_can address = {.can_family = AF_CAN};
    struct timeval patience = {.tv_usec = PASSED_WITHOUT * 1000};
    if (link < 0 || ioctl(link, SIOCGIFINDEX, &interface) < 0 ||
        (address.can_ifindex = interface.ifr_ifindex, bind(link, (struct sockaddr *)&address, sizeof address)) < 0 ||
        setsockopt(link, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) < 0) {
        fprintf(stderr, "%s: %s\n", name, strerror(errno));
        return 2;
    }
    struct can_frame frame;
    for (;;) {
        ssize_t size = read(link, &frame, sizeof frame);
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (size == (ssize_t)sizeof frame)
            tell(receiver, frame.can_id, frame.data, frame.can_dlc, now.tv_sec * INT64_C(1000000000) + now.tv_nsec);
        else if (errno == EAGAIN)
            puts("silence: nothing is known of the ground");
        else {
            fprintf(stderr, "%s: %s\n", name, strerror(errno));
            return 2;
        }
    }
}

int main(int count, char **arguments)
{
    bool simulated = count == 3 && strcmp(arguments[2], "--accept-simulated") == 0;
    if (count < 2 || (count == 3 && !simulated) || count > 3) {
        fprintf(stderr, "usage: %s INTERFACE|- [--accept-simulated]\n", arguments[0]);
        return 2;
    }
    struct ground_receiver receiver;
    ground_receiver_init(&receiver, 0.1, simulated);
    return strcmp(arguments[1], "-") == 0 ? read_log(&receiver) : listen_on(&receiver, arguments[1]);
}
