/* What a board brings: one file in boards/ for each kind. Everything else is the same on all of them. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

#define WATCHDOG_US 20000UL /* without a valid command for that time, the output is zero */

struct input_channel {
    const char *name;
    int16_t limit;       /* largest command, counts */
    int16_t slew_per_ms; /* fastest change, counts a millisecond */
};

enum reading { COUNTER = 0, CONVERTER = 1 };

struct output_channel {
    const char *name;
    uint8_t reading;
    int32_t low, high; /* ends of its range, counts */
};

extern const char *const board_name;
extern const uint32_t board_shortest_period_us;
extern const uint8_t board_inputs, board_outputs;
extern const struct input_channel board_input[];
extern const struct output_channel board_output[];

void board_begin(void); /* outputs at zero and disabled before anything else */
uint32_t board_micros(void);
bool board_receive(uint8_t *byte); /* false where none has come */
void board_send(uint8_t byte);
int32_t board_read(uint8_t output);
void board_drive(uint8_t input, int16_t counts); /* 0 is no pulse at all */
void board_enable(bool enabled);                 /* enable pin of the power stage */
bool board_stop_is_pressed(void);
void board_alive(void); /* within 15 ms, else the hardware watchdog resets the board */

#endif
