/* Prints the ground and the ankle's set-points as GaitEyes sends them on CAN, or why a frame may not be acted upon.
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
#include "setpoint_receiver.h"

enum { PASSED_WITHOUT = 200 /* ms: no ground for so long means no knowledge of the ground */ };

struct receivers {
    struct ground_receiver ground;
    struct setpoint_receiver setpoint;
};

static void tell_ground(struct ground_receiver *receiver, uint32_t frame_id, const uint8_t *data, size_t length,
                        int64_t t_ns)
{
    struct ground_estimate ground;
    enum frame_verdict found = ground_receiver_feed(receiver, frame_id, data, length, t_ns, &ground);
    if (found == FRAME_OK)
        printf("ground %+.4f %+.4f rad %.3f m sd %.4f %.4f %.4f age %.6f s calibration %03x\n",
               ground.slope_sagittal_rad, ground.slope_frontal_rad, ground.height_m, ground.slope_sagittal_sd_rad,
               ground.slope_frontal_sd_rad, ground.height_sd_m, ground.age_s, ground.calibration_id);
    else if (found != FRAME_FIRST_HALF && found != FRAME_OTHER_MESSAGE)
        printf("refused %s\n", frame_verdict_name(found));
}

static void tell_setpoint(struct setpoint_receiver *receiver, uint32_t frame_id, const uint8_t *data, size_t length,
                          int64_t t_ns)
{
    struct setpoint_update told;
    enum frame_verdict found = setpoint_receiver_feed(receiver, frame_id, data, length, t_ns, &told);
    if (found == FRAME_OK) {
        printf("setpoint slope %+.4f sd %.4f rad phase %u age %.6f s", told.slope_rad, told.slope_sd_rad, told.phase,
               told.age_s);
        for (int k = 0; k < SETPOINT_POINTS; k++)
            printf(" %+.4f %.1f %.2f", told.equilibrium_rad[k], told.stiffness_nm_per_rad[k],
                   told.damping_nms_per_rad[k]);
        printf(" sd %.3f %.2f %.2f\n", told.equilibrium_sd_rad, told.stiffness_sd_share, told.damping_sd_share);
    } else if (found != FRAME_FIRST_HALF && found != FRAME_OTHER_MESSAGE)
        printf("refused setpoint %s\n", frame_verdict_name(found));
}

static void tell(struct receivers *receivers, uint32_t frame_id, const uint8_t *data, size_t length, int64_t t_ns)
{
    tell_ground(&receivers->ground, frame_id, data, length, t_ns);
    tell_setpoint(&receivers->setpoint, frame_id, data, length, t_ns);
    fflush(stdout);
}

static int read_log(struct receivers *receivers)
{
    char line[256], hex[132];
    int64_t seconds, microseconds;
    uint32_t frame_id;
    while (fgets(line, sizeof line, stdin)) {
        hex[0] = '\0';
        if (sscanf(line, "(%" SCNd64 ".%" SCNd64 ") %*s %" SCNx32 "#%131[#0-9A-Fa-f]", &seconds, &microseconds, &frame_id,
                   hex) < 3) {
            fprintf(stderr, "not a line of candump -L: %s", line);
            return 2;
        }
        uint8_t data[64];
        const char *digits = hex[0] == '#' && hex[1] != '\0' ? hex + 2 : hex; /* of CAN FD: ## and a digit of flags */
        size_t length = strlen(digits) / 2;
        for (size_t place = 0; place < length; place++)
            sscanf(digits + 2 * place, "%2hhx", &data[place]);
        tell(receivers, frame_id, data, length, seconds * 1000000000 + microseconds * 1000);
    }
    return 0;
}

static int listen_on(struct receivers *receivers, const char *name)
{
    int link = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    struct ifreq interface = {0};
    strncpy(interface.ifr_name, name, sizeof interface.ifr_name - 1);
    struct sockaddr_can address = {.can_family = AF_CAN};
    int with_fd = 1; /* an interface without CAN FD refuses it, and has no such frames */
    struct timeval patience = {.tv_usec = PASSED_WITHOUT * 1000};
    if (link < 0 || ioctl(link, SIOCGIFINDEX, &interface) < 0 ||
        (address.can_ifindex = interface.ifr_ifindex, bind(link, (struct sockaddr *)&address, sizeof address)) < 0 ||
        setsockopt(link, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) < 0) {
        fprintf(stderr, "%s: %s\n", name, strerror(errno));
        return 2;
    }
    (void)setsockopt(link, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &with_fd, sizeof with_fd);
    struct canfd_frame frame;
    for (;;) {
        ssize_t size = read(link, &frame, sizeof frame);
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (size == (ssize_t)CAN_MTU || size == (ssize_t)CANFD_MTU)
            tell(receivers, frame.can_id, frame.data, frame.len, now.tv_sec * INT64_C(1000000000) + now.tv_nsec);
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
    struct receivers receivers;
    ground_receiver_init(&receivers.ground, 0.1, simulated);
    setpoint_receiver_init(&receivers.setpoint, 0.15, simulated);
    return strcmp(arguments[1], "-") == 0 ? read_log(&receivers) : listen_on(&receivers, arguments[1]);
}
