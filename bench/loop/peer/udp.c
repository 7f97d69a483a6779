/* Floor of the loop: samples and answers of the same sizes as datagrams on loopback, without ROS.

The environment variable PEER_PORT names the port of the DAQ; that of the controller is the next. */

#include "ticks.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>

/* Serialised ArmState and MotorCommand with the frame `flexarm/base_link`. */
enum { STATE_BYTES = 100, COMMAND_BYTES = 68 };

static int link_socket;
static struct sockaddr_in far_end;
static size_t size_sent;

static struct sockaddr_in address(int port) {
    struct sockaddr_in result = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    result.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return result;
}

static void open_link(int is_daq) {
    const char *port = getenv("PEER_PORT");
    require(port != NULL, "reading PEER_PORT");
    struct sockaddr_in own = address(atoi(port) + !is_daq);
    far_end = address(atoi(port) + is_daq);
    size_sent = is_daq ? STATE_BYTES : COMMAND_BYTES;
    link_socket = socket(AF_INET, SOCK_DGRAM, 0);
    require(link_socket >= 0, "socket");
    require(!bind(link_socket, (struct sockaddr *)&own, sizeof own), "bind");
}

static void send_number(uint64_t number) {
    char bytes[STATE_BYTES] = {0};
    memcpy(bytes, &number, sizeof number);
    /* The far end may not be there yet. */
    (void)sendto(link_socket, bytes, size_sent, 0, (struct sockaddr *)&far_end, sizeof far_end);
}

static uint64_t await_number(int64_t timeout_ns) {
    struct pollfd waited = {.fd = link_socket, .events = POLLIN};
    struct timespec timeout = {timeout_ns / SECOND_NS, timeout_ns % SECOND_NS};
    uint64_t newest = 0;
    char bytes[STATE_BYTES];
    if (ppoll(&waited, 1, &timeout, NULL) > 0) {
        while (recv(link_socket, bytes, sizeof bytes, MSG_DONTWAIT) > 0) {
            memcpy(&newest, bytes, sizeof newest);
        }
    }
    return newest;
}
