#include "protocol.h"

/* CRC-16 with the polynomial 0x1021, from 0xFFFF, high bit first. */
static uint16_t crc16(const uint8_t *bytes, uint8_t length)
{
    uint16_t crc = 0xFFFF;
    while (length--) {
        crc ^= (uint16_t)(*bytes++) << 8;
        for (uint8_t bit = 0; bit < 8; bit++)
            crc = (crc & 0x8000) ? (uint16_t)(crc << 1) ^ 0x1021 : (uint16_t)(crc << 1);
    }
    return crc;
}

void put_u8(struct frame *frame, uint8_t value)
{
    if (frame->length < MOST_CONTENT)
        frame->bytes[frame->length++] = value;
}

void put_u16(struct frame *frame, uint16_t value)
{
    put_u8(frame, value & 0xFF);
    put_u8(frame, value >> 8);
}

void put_u32(struct frame *frame, uint32_t value)
{
    put_u16(frame, value & 0xFFFF);
    put_u16(frame, value >> 16);
}

void put_text(struct frame *frame, const char *text)
{
    uint8_t length = 0;
    while (text[length])
        length++;
    put_u8(frame, length);
    while (length--)
        put_u8(frame, (uint8_t)*text++);
}

uint16_t get_u16(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | (uint16_t)bytes[1] << 8);
}

uint32_t get_u32(const uint8_t *bytes)
{
    return get_u16(bytes) | (uint32_t)get_u16(bytes + 2) << 16;
}

void send_frame(struct frame *frame, void (*send)(uint8_t))
{
    uint16_t crc = crc16(frame->bytes, frame->length);
    frame->bytes[frame->length++] = crc & 0xFF;
    frame->bytes[frame->length++] = crc >> 8;
    uint8_t start = 0;
    while (start <= frame->length) {
        uint8_t end = start;
        while (end < frame->length && frame->bytes[end])
            end++;
        send((uint8_t)(end - start + 1));
        while (start < end)
            send(frame->bytes[start++]);
        start++; /* the zero that the code byte stands for */
    }
    send(0);
    frame->length = 0;
}

/* Undo the coding in place; return the length, or 0 where the codes do not fit. */
static uint8_t uncoded(uint8_t *bytes, uint8_t length)
{
    uint8_t from = 0, to = 0;
    while (from < length) {
        uint8_t code = bytes[from++];
        if (code - 1 > length - from)
            return 0;
        for (uint8_t each = 1; each < code; each++)
            bytes[to++] = bytes[from++];
        if (from < length)
            bytes[to++] = 0;
    }
    return to;
}

uint8_t receive(struct receiver *receiver, uint8_t byte)
{
    if (byte) {
        if (receiver->length < sizeof receiver->bytes)
            receiver->bytes[receiver->length++] = byte;
        else
            receiver->overrun = 1;
        return 0;
    }
    uint8_t coded = receiver->length, overrun = receiver->overrun;
    receiver->length = receiver->overrun = 0;
    if (!coded)
        return 0;
    uint8_t length = overrun ? 0 : uncoded(receiver->bytes, coded);
    if (length < 3 || crc16(receiver->bytes, length - 2) != get_u16(receiver->bytes + length - 2)) {
        receiver->damaged++;
        return 0;
    }
    return length - 2;
}
