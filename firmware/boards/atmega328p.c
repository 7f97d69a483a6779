/* ATmega328P at 16 MHz, as on an Arduino Uno or Nano:
     D9  PWM, 20 kHz     D8  direction     D7  enable of the power stage     D4  stop button to ground
     D2  encoder A       D3  encoder B     A0  strain or acceleration        A1  another one            USB  500 kbaud */
#include "../board.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#define FULL 800         /* counts of the whole duty: 16 MHz / 20 kHz */
#define OVERSAMPLING 16  /* conversions in a reading, which is their sum */

const char *const board_name = "atmega328p";
const uint32_t board_shortest_period_us = 2000;
const uint8_t board_inputs = 1, board_outputs = 3;
const struct input_channel board_input[] = {{"motor", FULL, 400}};
const struct output_channel board_output[] = {
    {"encoder", COUNTER, INT32_MIN, INT32_MAX},
    {"a0", CONVERTER, 0, 1023 * OVERSAMPLING},
    {"a1", CONVERTER, 0, 1023 * OVERSAMPLING},
};

static volatile uint8_t received[64], taken, come; /* a ring; all of it is counted modulo 64 */
static volatile uint8_t sent[128], gone, queued;
static volatile uint32_t ticks; /* overflows of timer 0, 256 ticks of 4 us each */
static volatile int32_t turns;
static uint8_t lines;

/* The watchdog that has reset the board is still on, with its shortest time. */
void reset_is_over(void) __attribute__((naked, used, section(".init3")));
void reset_is_over(void)
{
    MCUSR = 0;
    wdt_disable();
}

void board_begin(void)
{
    PORTD &= ~_BV(PD7);
    DDRD |= _BV(PD7);
    PORTB &= ~(_BV(PB0) | _BV(PB1));
    DDRB |= _BV(PB0) | _BV(PB1);
    PORTD |= _BV(PD2) | _BV(PD3) | _BV(PD4); /* pull-ups */
    ICR1 = FULL - 1;
    TCCR1A = _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);
    TCCR0B = _BV(CS01) | _BV(CS00);
    TIMSK0 = _BV(TOIE0);
    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | _BV(ADPS2); /* 1 MHz: nine good bits, and the sum has more */
    UCSR0A = _BV(U2X0);
    UBRR0 = 3;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    lines = PIND & (_BV(PD2) | _BV(PD3));
    EICRA = _BV(ISC00) | _BV(ISC10);
    EIMSK = _BV(INT0) | _BV(INT1);
    wdt_enable(WDTO_15MS);
    sei();
}

ISR(TIMER0_OVF_vect)
{
    ticks++;
}

uint32_t board_micros(void)
{
    uint32_t full;
    uint8_t part;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        full = ticks;
        part = TCNT0;
        if ((TIFR0 & _BV(TOV0)) && part < 255)
            full++;
    }
    return (full << 8 | part) * 4;
}

ISR(USART_RX_vect)
{
    uint8_t byte = UDR0, next = (come + 1) % sizeof received;
    if (next != taken) {
        received[come] = byte;
        come = next;
    }
}

bool board_receive(uint8_t *byte)
{
    if (taken == come)
        return false;
    *byte = received[taken];
    taken = (taken + 1) % sizeof received;
    return true;
}

ISR(USART_UDRE_vect)
{
    UDR0 = sent[gone];
    gone = (gone + 1) % sizeof sent;
    if (gone == queued)
        UCSR0B &= ~_BV(UDRIE0);
}

void board_send(uint8_t byte)
{
    uint8_t next = (queued + 1) % sizeof sent;
    while (next == gone)
        ;
    sent[queued] = byte;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        queued = next;
        UCSR0B |= _BV(UDRIE0);
    }
}

/* Each edge of A or B is a quarter of a line. */
static inline void count(void)
{
    uint8_t now = PIND & (_BV(PD2) | _BV(PD3));
    uint8_t changed = now ^ lines;
    bool a = now & _BV(PD2), b = now & _BV(PD3);
    if (changed == _BV(PD2))
        turns += a != b ? 1 : -1;
    else if (changed == _BV(PD3))
        turns += a == b ? 1 : -1;
    lines = now;
}

ISR(INT0_vect)
{
    count();
}

ISR(INT1_vect)
{
    count();
}

int32_t board_read(uint8_t output)
{
    int32_t value = 0;
    if (output == 0) {
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) value = turns;
        return value;
    }
    ADMUX = _BV(REFS0) | (output - 1);
    for (uint8_t i = 0; i < OVERSAMPLING; i++) {
        ADCSRA |= _BV(ADSC);
        while (ADCSRA & _BV(ADSC))
            ;
        value += ADC;
    }
    return value;
}

void board_drive(uint8_t input, int16_t counts)
{
    (void)input;
    uint16_t size = counts < 0 ? -counts : counts;
    if (!size) {
        TCCR1A &= ~_BV(COM1A1); /* a compare at 0 would still give a pulse of one cycle */
        return;
    }
    if (counts > 0)
        PORTB |= _BV(PB0);
    else
        PORTB &= ~_BV(PB0);
    OCR1A = size - 1;
    TCCR1A |= _BV(COM1A1);
}

void board_enable(bool enabled)
{
    if (enabled)
        PORTD |= _BV(PD7);
    else
        PORTD &= ~_BV(PD7);
}

bool board_stop_is_pressed(void)
{
    return !(PIND & _BV(PD4));
}

void board_alive(void)
{
    wdt_reset();
}
