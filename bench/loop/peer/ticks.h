/* Loop of a peer: a DAQ that ticks on absolute deadlines, and a controller that answers it.

A program includes this file and defines its transport below the declarations. Its arguments are
`controller`, or `daq RATE_HZ SECONDS`. The DAQ prints one line of JSON. */

#define _GNU_SOURCE
#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <time.h>

/* Open both ways of the link; the DAQ sends samples and awaits answers. */
static void open_link(int is_daq);
/* Send the sample, or the answer to the sample, of this number. */
static void send_number(uint64_t number);
/* Return the number of the newest message that came within the time; 0 without one. */
static uint64_t await_number(int64_t timeout_ns);

#define SECOND_NS 1000000000LL
/* A timed wait wakes up late, so the last part of a period is slept. */
#define WAKE_MARGIN_NS 200000
#define SETTLE_S 2
#define PATIENCE_S 30

static int64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * SECOND_NS + now.tv_nsec;
}

static void sleep_until(int64_t deadline_ns) {
    struct timespec deadline = {deadline_ns / SECOND_NS, deadline_ns % SECOND_NS};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL) == EINTR) {
    }
}

/* End with a line that says what failed. */
static void require(int holds, const char *what) {
    if (!holds) {
        fprintf(stderr, "peer: %s failed\n", what);
        exit(1);
    }
}

/* Take the priority that the nodes with a loop take; without the right to it, go on. */
static void prefer_realtime(void) {
    const char *wanted = getenv("FLEXARM_PRIORITY");
    struct sched_param priority = {wanted ? atoi(wanted) : 20};
    if (priority.sched_priority > 0) {
        (void)sched_setscheduler(0, SCHED_FIFO, &priority);
    }
}

static int compared(const void *left, const void *right) {
    int64_t a = *(const int64_t *)left, b = *(const int64_t *)right;
    return (a > b) - (a < b);
}

/* Return a share of sorted times in ms. */
static double share_ms(const int64_t *sorted_ns, size_t count, double share) {
    size_t rank = (size_t)(share * (double)count + 0.999999);
    return count ? 1e-6 * (double)sorted_ns[rank ? rank - 1 : 0] : -1.0;
}

static double cpu_s(void) {
    struct rusage used;
    getrusage(RUSAGE_SELF, &used);
    return (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
           1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
}

/* Send one sample, await its answer until the deadline; return the time that it took, or -1. */
static int64_t tick(uint64_t number, int64_t deadline_ns) {
    int64_t begun_ns = now_ns(), reply_ns = -1, left_ns;
    send_number(number);
    while ((left_ns = deadline_ns - now_ns()) > WAKE_MARGIN_NS) {
        if (await_number(left_ns - WAKE_MARGIN_NS) == number) {
            reply_ns = now_ns() - begun_ns;
        }
    }
    sleep_until(deadline_ns);
    if (reply_ns < 0 && await_number(0) == number) {
        reply_ns = now_ns() - begun_ns;
    }
    return reply_ns;
}

static void run_daq(double rate_hz, double length_s) {
    int64_t period_ns = (int64_t)(1e9 / rate_hz), deadline_ns = now_ns();
    uint64_t number = 0, settled = 0, samples = (uint64_t)(rate_hz * length_s);
    uint64_t taken = 0, missed = 0, answered = 0;
    int64_t *replies_ns = malloc(samples * sizeof *replies_ns);
    int64_t first_ns = deadline_ns + PATIENCE_S * SECOND_NS;
    double used_s = 0.0;
    require(replies_ns != NULL, "malloc");
    while (taken < samples) {
        deadline_ns += period_ns;
        int64_t reply_ns = tick(++number, deadline_ns);
        int64_t skipped = (now_ns() - deadline_ns) / period_ns;
        deadline_ns += skipped * period_ns;
        number += (uint64_t)skipped;
        if (settled < SETTLE_S * rate_hz) {
            require(settled || deadline_ns < first_ns, "the wait for an answer");
            settled += reply_ns >= 0;
            used_s = cpu_s();
            continue;
        }
        taken++;
        missed += (uint64_t)skipped;
        if (reply_ns >= 0) {
            replies_ns[answered++] = reply_ns;
        }
    }
    used_s = cpu_s() - used_s;
    qsort(replies_ns, answered, sizeof *replies_ns, compared);
    printf("{\"p50\": %.6f, \"p99\": %.6f, \"p999\": %.6f, \"max\": %.6f, ",
           share_ms(replies_ns, answered, 0.5), share_ms(replies_ns, answered, 0.99),
           share_ms(replies_ns, answered, 0.999), share_ms(replies_ns, answered, 1.0));
    printf("\"samples\": %llu, \"unanswered\": %llu, \"missed\": %llu, \"cpu\": %.6f}\n",
           (unsigned long long)taken, (unsigned long long)(taken - answered),
           (unsigned long long)missed, used_s / length_s);
}

int main(int argc, char **argv) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    prefer_realtime();
    if (argc == 4 && !strcmp(argv[1], "daq")) {
        open_link(1);
        run_daq(atof(argv[2]), atof(argv[3]));
        return 0;
    }
    require(argc == 2 && !strcmp(argv[1], "controller"), "reading the arguments");
    open_link(0);
    for (;;) {
        uint64_t number = await_number(SECOND_NS / 10);
        if (number) {
            send_number(number);
        }
    }
}
