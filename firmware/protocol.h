/* Frames between host and board: docs/serial_protocol.md says what they mean. */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdint.h>

#define PROTOCOL_VERSION 1
#define MOST_CONTENT 120 /* bytes of a frame without its check; one block of COBS has up to 254 */

enum from_host { HELLO = 0x01, START = 0x02, COMMAND = 0x03, STOP = 0x04 };
enum from_board { GREETING = 0x81, SAMPLE = 0x82 };
enum status { STOPPED = 0x01, DRIVEN = 0x02 };

/* Frame in the making: content, then its check. */
struct frame {
    uint8_t bytes[MOST_CONTENT + 2];
    uint8_t length;
};

void put_u8(struct frame *frame, uint8_t value);
void put_u16(struct frame *frame, uint16_t value);
void put_u32(struct frame *frame, uint32_t value);
void put_text(struct frame *frame, const char *text);
uint16_t get_u16(const uint8_t *bytes);
uint32_t get_u32(const uint8_t *bytes);

/* Add the check, code the frame, and hand its bytes to `send`, with the zero that ends it. */
void send_frame(struct frame *frame, void (*send)(uint8_t));

/* Receiver of one direction. */
struct receiver {
    uint8_t bytes[MOST_CONTENT + 4];
    uint8_t length;
    uint8_t overrun;
    uint8_t damaged; /* frames that failed a check, modulo 256 */
};

/* Take a byte; return the length of the content of a whole frame, at `bytes`, or 0. */
uint8_t receive(struct receiver *receiver, uint8_t byte);

#endif
