/* Arm on a serial line: samples by the board's clock, commands that answer them, and zero in every other case. */
#include "board.h"
#include "protocol.h"

#define MOST_INPUTS 4
#define SLEW_STEP_US 100

enum state { IDLE, RUNNING, HELD };

static enum state state;
static struct receiver from_host;
static uint32_t period_us, next_us, commanded_us, slewed_us;
static uint16_t sequence, answered;
static int16_t target[MOST_INPUTS], applied[MOST_INPUTS];
static bool driven;
static uint8_t silences;

static void zero(void)
{
    for (uint8_t i = 0; i < board_inputs; i++) {
        target[i] = applied[i] = 0;
        board_drive(i, 0);
    }
    board_enable(false);
    driven = false;
}

static void greet(void)
{
    static struct frame frame;
    put_u8(&frame, GREETING);
    put_u8(&frame, PROTOCOL_VERSION);
    put_text(&frame, board_name);
    put_u32(&frame, board_shortest_period_us);
    put_u16(&frame, WATCHDOG_US / 1000);
    put_u8(&frame, board_inputs);
    put_u8(&frame, board_outputs);
    for (uint8_t i = 0; i < board_inputs; i++) {
        put_u16(&frame, (uint16_t)board_input[i].limit);
        put_u16(&frame, (uint16_t)board_input[i].slew_per_ms);
        put_text(&frame, board_input[i].name);
    }
    for (uint8_t i = 0; i < board_outputs; i++) {
        put_u8(&frame, board_output[i].reading);
        put_u32(&frame, (uint32_t)board_output[i].low);
        put_u32(&frame, (uint32_t)board_output[i].high);
        put_text(&frame, board_output[i].name);
    }
    send_frame(&frame, board_send);
}

static void sample(void)
{
    static struct frame frame;
    sequence++;
    put_u8(&frame, SAMPLE);
    put_u16(&frame, sequence);
    put_u32(&frame, board_micros());
    put_u8(&frame, (state == HELD ? STOPPED : 0) | (driven ? DRIVEN : 0));
    put_u8(&frame, silences);
    put_u8(&frame, from_host.damaged);
    put_u16(&frame, answered);
    for (uint8_t i = 0; i < board_inputs; i++)
        put_u16(&frame, (uint16_t)applied[i]);
    for (uint8_t i = 0; i < board_outputs; i++)
        put_u32(&frame, (uint32_t)board_read(i));
    send_frame(&frame, board_send);
}

static int16_t clipped(int32_t value, int16_t limit)
{
    return value > limit ? limit : value < -limit ? -limit : (int16_t)value;
}

static void command(const uint8_t *content)
{
    uint16_t answers = get_u16(content);
    bool is_zero = true;
    for (uint8_t i = 0; i < board_inputs; i++)
        is_zero &= get_u16(content + 2 + 2 * i) == 0;
    /* Bytes that a stopped host or a buffer held back answer an old sample. A zero is always right. */
    uint32_t age_us = (uint16_t)(sequence - answers) * period_us;
    if (state != RUNNING || (age_us > WATCHDOG_US && !is_zero))
        return;
    commanded_us = board_micros();
    answered = answers;
    for (uint8_t i = 0; i < board_inputs; i++)
        target[i] = clipped((int16_t)get_u16(content + 2 + 2 * i), board_input[i].limit);
    if (is_zero) {
        zero();
    } else if (!driven) {
        driven = true;
        slewed_us = commanded_us - 1000;
        board_enable(true);
    }
}

static void obey(const uint8_t *content, uint8_t length)
{
    uint8_t type = content[0];
    if (type == HELLO && length == 1) {
        greet();
    } else if (type == START && length == 5) {
        zero();
        period_us = get_u32(content + 1);
        if (period_us < board_shortest_period_us)
            period_us = board_shortest_period_us;
        sequence = answered = 0;
        silences = from_host.damaged = 0;
        next_us = board_micros();
        state = board_stop_is_pressed() ? HELD : RUNNING;
    } else if (type == COMMAND && length == 3 + 2 * board_inputs) {
        command(content + 1);
    } else if (type == STOP && length == 1) {
        zero();
        state = IDLE;
    } else {
        from_host.damaged++;
    }
}

/* Move the outputs to their targets, as fast as the board's own slew allows. */
static void slew(void)
{
    uint32_t passed_us = board_micros() - slewed_us;
    if (!driven || passed_us < SLEW_STEP_US)
        return;
    slewed_us += passed_us;
    if (passed_us > 1000)
        passed_us = 1000;
    for (uint8_t i = 0; i < board_inputs; i++) {
        int32_t most = (int32_t)passed_us * board_input[i].slew_per_ms / 1000;
        int32_t change = (int32_t)target[i] - applied[i];
        change = change > most ? most : change < -most ? -most : change;
        applied[i] = (int16_t)(applied[i] + change);
        board_drive(i, applied[i]);
    }
}

int main(void)
{
    board_begin();
    zero();
    board_send(0); /* the reset may have cut a frame */
    greet();
    for (;;) {
        uint8_t byte, length;
        board_alive();
        if (board_receive(&byte) && (length = receive(&from_host, byte)))
            obey(from_host.bytes, length);
        if (state == RUNNING && board_stop_is_pressed()) {
            zero();
            state = HELD;
        }
        if (driven && board_micros() - commanded_us > WATCHDOG_US) {
            zero();
            silences++;
        }
        slew();
        if (state != IDLE && (int32_t)(board_micros() - next_us) >= 0) {
            next_us += period_us;
            sample();
        }
    }
}
