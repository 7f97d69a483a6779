/* Peer of the loop on rcl, which rclcpp and rclpy wrap: the messages of flexarm, its topics' QoS. */

#include "ticks.h"

#include <flexarm_msgs/msg/arm_state.h>
#include <flexarm_msgs/msg/motor_command.h>
#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <rosidl_runtime_c/string_functions.h>

enum { SENT_DEPTH = 10000, NEWEST_DEPTH = 1 };

static int is_daq_end;
static rcl_publisher_t publisher;
static rcl_subscription_t subscription;
static rcl_wait_set_t wait_set;
static flexarm_msgs__msg__ArmState state;
static flexarm_msgs__msg__MotorCommand command;

static rmw_qos_profile_t reliable(size_t depth) {
    rmw_qos_profile_t qos = rmw_qos_profile_default;
    qos.depth = depth;
    return qos;
}

static void open_link(int is_daq) {
    static rcl_context_t context;
    static rcl_node_t node;
    rcl_allocator_t allocator = rcl_get_default_allocator();
    rcl_init_options_t options = rcl_get_zero_initialized_init_options();
    rcl_node_options_t node_options = rcl_node_get_default_options();
    const rosidl_message_type_support_t *states =
        ROSIDL_GET_MSG_TYPE_SUPPORT(flexarm_msgs, msg, ArmState);
    const rosidl_message_type_support_t *commands =
        ROSIDL_GET_MSG_TYPE_SUPPORT(flexarm_msgs, msg, MotorCommand);
    rcl_publisher_options_t sent = rcl_publisher_get_default_options();
    rcl_subscription_options_t read = rcl_subscription_get_default_options();
    sent.qos = reliable(SENT_DEPTH);
    read.qos = reliable(NEWEST_DEPTH);
    is_daq_end = is_daq;
    context = rcl_get_zero_initialized_context();
    node = rcl_get_zero_initialized_node();
    publisher = rcl_get_zero_initialized_publisher();
    subscription = rcl_get_zero_initialized_subscription();
    wait_set = rcl_get_zero_initialized_wait_set();
    require(!rcl_init_options_init(&options, allocator), "rcl_init_options_init");
    require(!rcl_init(0, NULL, &options, &context), "rcl_init");
    require(!rcl_node_init(&node, is_daq ? "daq" : "controller", "/peer", &context, &node_options),
            "rcl_node_init");
    require(!rcl_publisher_init(&publisher, &node, is_daq ? states : commands,
                                is_daq ? "state" : "command", &sent),
            "rcl_publisher_init");
    require(!rcl_subscription_init(&subscription, &node, is_daq ? commands : states,
                                   is_daq ? "command" : "state", &read),
            "rcl_subscription_init");
    require(!rcl_wait_set_init(&wait_set, 1, 0, 0, 0, 0, 0, &context, allocator),
            "rcl_wait_set_init");
    require(flexarm_msgs__msg__ArmState__init(&state) &&
                flexarm_msgs__msg__MotorCommand__init(&command) &&
                rosidl_runtime_c__String__assign(&state.header.frame_id, "flexarm/base_link") &&
                rosidl_runtime_c__String__assign(&command.header.frame_id, "flexarm/base_link"),
            "making the messages");
}

static void stamp(builtin_interfaces__msg__Time *time) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    time->sec = (int32_t)now.tv_sec;
    time->nanosec = (uint32_t)now.tv_nsec;
}

static void send_number(uint64_t number) {
    if (is_daq_end) {
        stamp(&state.header.stamp);
        state.sequence = number;
        require(!rcl_publish(&publisher, &state, NULL), "rcl_publish");
    } else {
        stamp(&command.header.stamp);
        command.sequence = command.state_sequence = number;
        command.effort_v = -state.position_v;
        require(!rcl_publish(&publisher, &command, NULL), "rcl_publish");
    }
}

/* Take every message that is there; return the number of the last one. */
static uint64_t take_newest(void) {
    uint64_t newest = 0;
    void *message = is_daq_end ? (void *)&command : (void *)&state;
    while (rcl_take(&subscription, message, NULL, NULL) == RCL_RET_OK) {
        newest = is_daq_end ? command.state_sequence : state.sequence;
    }
    rcl_reset_error();
    return newest;
}

static uint64_t await_number(int64_t timeout_ns) {
    uint64_t newest = take_newest();
    if (newest || !timeout_ns) {
        return newest;
    }
    require(!rcl_wait_set_clear(&wait_set), "rcl_wait_set_clear");
    require(!rcl_wait_set_add_subscription(&wait_set, &subscription, NULL), "adding to wait set");
    rcl_ret_t ended = rcl_wait(&wait_set, timeout_ns);
    require(!ended || ended == RCL_RET_TIMEOUT, "rcl_wait");
    rcl_reset_error();
    return take_newest();
}
