/* The firmware's image on a simulated ATmega328P, with a flexible arm behind its pins and a pseudo-terminal as its cable.

   simavr_board IMAGE [PATIENCE_MS]
   Its time follows the clock. With a patience it also stands still, so long at most, for a host that owes its answer to a sample:
   on a busy machine the arm becomes slow, and loses no command.
   It prints `pty PATH`, then at each change of the output, by the board's clock, `drive US` or `zero US SILENCE`, with the
   microseconds since the last byte that came. Lines that it reads: mark TEXT, reset, hang (the program stands still, its
   interrupts go on), press, release, unplug, state, turn RAD (a hand holds the hub there), free. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#define CYCLES_PER_US 16
#define STEP_US 50
#define BYTES_PER_STEP 2
#define BOOT_US 5000
#define ANSWER_US 2000   /* a host that is later is waited for */
#define ANSWERING 100    /* bytes of a host that answers: it has sent more than a greeting */
#define COUNTS_PER_RAD (4096 / (2 * M_PI))

static avr_t *avr;
static elf_firmware_t image;
static avr_irq_t *uart;
static int cable = -1;
static int accepts = 1;
static unsigned long long before_us; /* time of the boards before the last reset */
static unsigned long long told_us;   /* end of the last frame to the host */
static unsigned long long heard_us;  /* last byte of the host */
static unsigned heard;               /* bytes of a host that answers */

static unsigned long long now_us(void)
{
    return before_us + avr->cycle / CYCLES_PER_US;
}

static void to_host(struct avr_irq_t *irq, uint32_t byte, void *param)
{
    (void)irq, (void)param;
    uint8_t value = byte;
    if (!value)
        told_us = now_us();
    if (cable >= 0 && write(cable, &value, 1) < 0)
        return; /* nobody reads: the line has no flow control */
}

static void to_board_waits(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value, (void)param;
    accepts = 0;
}

static void to_board_goes_on(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value, (void)param;
    accepts = 1;
}

/* Drive an input pin of port D. simavr takes a pin for floating at each write of its port unless it is told otherwise. */
static void set_pin(int number, int level)
{
    static unsigned char mask, value;
    mask |= 1 << number;
    value = level ? value | 1 << number : value & ~(1 << number);
    avr_ioport_external_t external = {.name = 'D', .mask = mask, .value = value};
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &external);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), number), level);
}

/* After a reset simavr takes a level that it knows already for no change. */
static void idle_pins(void)
{
    for (int number = 2; number <= 4; number++)
        set_pin(number, 0), set_pin(number, 1);
}

/* Torque of the motor, N m: half a newton metre at the whole duty. */
static double torque_nm(void)
{
    int compare = avr->data[0x88] | avr->data[0x89] << 8;
    int pulses = avr->data[0x80] & 0x80, enabled = avr->data[0x2B] & 0x80;
    if (!pulses || !enabled)
        return 0.0;
    return (avr->data[0x25] & 1 ? 0.5 : -0.5) * (compare + 1) / 800.0;
}

static double hub_rad, tip_rad, hub_rad_per_s, tip_rad_per_s;
static double hand_rad = NAN; /* where a hand holds the hub */

static void move_arm(double torque)
{
    const double hub_kg_m2 = 0.002, tip_kg_m2 = 0.01, spring = 4.0, damping = 0.01, drag = 0.01, h = STEP_US * 1e-6;
    if (!isnan(hand_rad))
        torque += 2.0 * (hand_rad - hub_rad) - 0.2 * hub_rad_per_s;
    double bend = spring * (tip_rad - hub_rad) + damping * (tip_rad_per_s - hub_rad_per_s);
    hub_rad_per_s += h * (torque + bend - drag * hub_rad_per_s) / hub_kg_m2;
    tip_rad_per_s -= h * bend / tip_kg_m2;
    hub_rad += h * hub_rad_per_s;
    tip_rad += h * tip_rad_per_s;
}

/* Turn the encoder by at most one count, and put the bending on the first input of the converter. */
static void show_arm(void)
{
    static int counts;
    static const uint8_t phase_a[] = {1, 0, 0, 1}, phase_b[] = {1, 1, 0, 0};
    int wanted = (int)floor(hub_rad * COUNTS_PER_RAD);
    /* simavr takes a low level for interrupts until the firmware has chosen the edges. */
    if (wanted != counts && avr->cycle > BOOT_US * CYCLES_PER_US) {
        counts += wanted > counts ? 1 : -1;
        set_pin(2, phase_a[counts & 3]);
        set_pin(3, phase_b[counts & 3]);
    }
    double millivolts = 2500.0 + 2000.0 * (tip_rad - hub_rad) + 20.0 * (rand() / (double)RAND_MAX - 0.5);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), (uint32_t)fmax(0.0, fmin(5000.0, millivolts)));
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC1), 1250);
}

/* A board as after its power-up: simavr's own reset leaves what was under way. */
static void begin_board(void)
{
    if (avr)
        before_us = now_us();
    avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    avr_load_firmware(avr, &image);
    avr->vcc = avr->avcc = avr->aref = 5000;
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    avr_irq_register_notify(uart + UART_IRQ_OUTPUT, to_host, NULL);
    avr_irq_register_notify(uart + UART_IRQ_OUT_XOFF, to_board_waits, NULL);
    avr_irq_register_notify(uart + UART_IRQ_OUT_XON, to_board_goes_on, NULL);
    accepts = 1;
    idle_pins();
}

/* Send the program into a loop without end, in the last word of the flash. */
static void hang(void)
{
    avr->pc = avr->flashend - 1;
    avr->flash[avr->pc] = 0xFF, avr->flash[avr->pc + 1] = 0xCF;
}

/* Run an instruction, which may be one of a reset by the watchdog. */
static void run(void)
{
    avr_run_t before = avr->run;
    int state = avr_run(avr);
    if (state == cpu_Done || state == cpu_Crashed)
        exit(3);
    if (avr->run != before)
        idle_pins();
}

static void obey(const char *line)
{
    if (!strncmp(line, "mark ", 5))
        printf("%s %llu\n", line + 5, now_us());
    else if (!strcmp(line, "reset"))
        begin_board();
    else if (!strcmp(line, "hang"))
        hang();
    else if (!strcmp(line, "press"))
        set_pin(4, 0);
    else if (!strcmp(line, "release"))
        set_pin(4, 1);
    else if (!strncmp(line, "turn ", 5))
        hand_rad = atof(line + 5);
    else if (!strcmp(line, "free"))
        hand_rad = NAN;
    else if (!strcmp(line, "unplug"))
        close(cable), cable = -1;
    else if (!strcmp(line, "state"))
        printf("state %llu %.6f %.6f\n", now_us(), hub_rad, tip_rad);
}

static void listen(void)
{
    static char line[80];
    static size_t length;
    char letter;
    /* Not O_NONBLOCK: a terminal would keep it for the shell. */
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    while (poll(&input, 1, 0) == 1) {
        if (read(STDIN_FILENO, &letter, 1) != 1)
            exit(0);
        if (letter != '\n' && length < sizeof line - 1) {
            line[length++] = letter;
            continue;
        }
        line[length] = 0;
        length = 0;
        obey(line);
    }
}

static double wall_s(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

/* Keep the board's time at that of the wall; time that the machine has lost is not caught up. */
static void keep_pace(void)
{
    static double ahead_s;
    if (!ahead_s)
        ahead_s = wall_s() - 1e-6 * now_us();
    double early_s = ahead_s + 1e-6 * now_us() - wall_s();
    if (early_s > 0.0)
        usleep((useconds_t)(1e6 * early_s));
    else if (early_s < -0.005)
        ahead_s -= early_s;
}

/* Stand still while the host owes an answer. */
static void wait_for_host(int patience_ms)
{
    if (heard < ANSWERING || cable < 0 || heard_us > told_us || now_us() < told_us + ANSWER_US)
        return;
    struct pollfd input = {.fd = cable, .events = POLLIN};
    if (poll(&input, 1, patience_ms) < 1 || !(input.revents & POLLIN))
        heard = 0;
}

int main(int count, char **arguments)
{
    int terminal;
    struct termios raw;
    int patience_ms = count == 3 ? atoi(arguments[2]) : 0;
    if (count < 2 || count > 3 || elf_read_firmware(arguments[1], &image))
        return 2;
    image.frequency = CYCLES_PER_US * 1000000UL;

    char name[64];
    if (openpty(&cable, &terminal, name, NULL, NULL))
        return 2;
    tcgetattr(terminal, &raw);
    cfmakeraw(&raw);
    tcsetattr(terminal, TCSANOW, &raw);
    fcntl(cable, F_SETFL, O_NONBLOCK);
    setvbuf(stdout, NULL, _IOLBF, 0);
    printf("pty %s\n", name);
    begin_board();

    int driven = 0;
    for (unsigned step = 0;; step++) {
        avr_cycle_count_t until = avr->cycle + STEP_US * CYCLES_PER_US;
        while (avr->cycle < until)
            run();
        uint8_t byte;
        for (int each = 0; each < BYTES_PER_STEP && accepts && cable >= 0 && read(cable, &byte, 1) == 1; each++) {
            avr_raise_irq(uart + UART_IRQ_INPUT, byte);
            heard_us = now_us();
            heard++;
        }
        if (patience_ms)
            wait_for_host(patience_ms);
        double torque = torque_nm();
        if ((torque != 0.0) != driven) {
            driven = !driven;
            if (driven)
                printf("drive %llu\n", now_us());
            else
                printf("zero %llu %llu\n", now_us(), now_us() - heard_us);
        }
        move_arm(torque);
        show_arm();
        if (step % 20 == 0) {
            listen();
            keep_pace();
        }
    }
}
