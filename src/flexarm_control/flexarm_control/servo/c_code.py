"""Servo controller as a C99 and C++ header without a library, for a microcontroller."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.servo.controller import ARRAYS, PLAN_ROWS
from flexarm_core.outputs import MARK
from flexarm_ident.models.c_header import c_string, number_lines

if TYPE_CHECKING:
    from flexarm_control.servo.controller import ServoGains

_BIG = "1e308"
_STEP = """
typedef struct {
    double state[2][SERVO_STATES];
    double plan[SERVO_PLAN_ROWS][SERVO_TRACKED];
    double long_window[SERVO_LONG][SERVO_TRACKED];
    double short_window[SERVO_SHORT][SERVO_TRACKED];
    int place[2];
    int begun;
} servo_controller;

/* Forgets the past: the next step takes the plant for at rest where it then is. */
static inline void servo_reset(servo_controller *s)
{
    int i;
    s->place[0] = s->place[1] = s->begun = 0;
}

static inline double servo_within(double value, double bound)
{
    return value > bound ? bound : value < -bound ? -bound : value;
}

static inline void servo_average(double (*plan)[SERVO_TRACKED], int row,
                                 double (*window)[SERVO_TRACKED], int size, int *place)
{
    int j, k;
    for (j = 0; j < SERVO_TRACKED; j++) {
        plan[row + 1][j] += (plan[row][j] - window[*place][j]) / size;
        window[*place][j] = plan[row][j];
    }
    *place = (*place + 1) % size;
    if (*place != 0) return;
    for (j = 0; j < SERVO_TRACKED; j++) {
        double total = 0.0;
        for (k = 0; k < size; k++) total += window[k][j];
        plan[row + 1][j] = total / size;
    }
}

/* Takes the outputs y and the set-points r of a sample; writes the commands u. */
static inline void servo_step(servo_controller *s, const double *y, const double *r, double *u)
{
    double now[SERVO_STATES], next[2][SERVO_STATES], net[SERVO_INPUTS], wanted[SERVO_INPUTS];
    int i, j, k;
    if (!s->begun) {
        s->begun = 1;
        for (j = 0; j < SERVO_TRACKED; j++) {
            double start = y[servo_tracked_output[j]];
            for (k = 0; k < SERVO_PLAN_ROWS; k++) s->plan[k][j] = start;
            for (k = 0; k < SERVO_LONG; k++) s->long_window[k][j] = start;
            for (k = 0; k < SERVO_SHORT; k++) s->short_window[k][j] = start;
        }
        for (i = 0; i < SERVO_STATES; i++) {
            double total = 0.0;
            for (j = 0; j < SERVO_TRACKED; j++)
                total += servo_rest[i * SERVO_TRACKED + j] * y[servo_tracked_output[j]];
            s->state[0][i] = s->state[1][i] = total;
        }
    }
    for (j = 0; j < SERVO_TRACKED; j++) {
        s->plan[4][j] = s->plan[3][j];
        s->plan[3][j] = s->plan[2][j];
        s->plan[0][j] += servo_within(r[j] - s->plan[0][j], servo_slopes[j]);
    }
    servo_average(s->plan, 0, s->long_window, SERVO_LONG, &s->place[0]);
    servo_average(s->plan, 1, s->short_window, SERVO_SHORT, &s->place[1]);
    for (j = 0; j < SERVO_TRACKED; j++) {
        s->plan[5][j] = s->plan[3][j] - s->plan[4][j];
        s->plan[6][j] = s->plan[2][j] - 2.0 * s->plan[3][j] + s->plan[4][j];
    }
    for (i = 0; i < SERVO_STATES; i++) now[i] = s->state[0][i];
    for (k = 0; k < SERVO_OUTPUTS; k++) {
        double error = y[k];
        for (i = 0; i < SERVO_STATES; i++) error -= servo_c[k * SERVO_STATES + i] * s->state[0][i];
        for (i = 0; i < SERVO_STATES; i++)
            now[i] += servo_correction[i * SERVO_OUTPUTS + k] * error;
    }
    for (i = 0; i < SERVO_INPUTS; i++) {
        double total = 0.0, part = 0.0, friction;
        wanted[i] = 0.0;
        for (k = 0; k < 3; k++)
            for (j = 0; j < SERVO_TRACKED; j++)
                wanted[i] += servo_forward[(k * SERVO_INPUTS + i) * SERVO_TRACKED + j]
                             * s->plan[4 + k][j];
        for (j = 0; j < SERVO_STATES; j++)
            wanted[i] -= servo_planning[i * SERVO_STATES + j] * s->state[1][j];
        total = wanted[i];
        for (j = 0; j < SERVO_STATES; j++)
            total -= servo_feedback[i * SERVO_STATES + j] * (now[j] - s->state[1][j]);
        for (j = 0; j < SERVO_TRACKED; j++)
            part += servo_onsets[i * SERVO_TRACKED + j] * s->plan[5][j];
        friction = servo_levels[i] * servo_within(part, 1.0);
        u[i] = servo_within(total + friction, servo_limits[i]);
        net[i] = u[i] - friction;
    }
    for (i = 0; i < SERVO_STATES; i++) {
        double total = 0.0, ahead = 0.0;
        for (j = 0; j < SERVO_STATES; j++) {
            total += servo_deviation[i * SERVO_STATES + j] * (now[j] - s->state[1][j]);
            ahead += servo_a[i * SERVO_STATES + j] * s->state[1][j];
        }
        total += ahead;
        for (j = 0; j < SERVO_INPUTS; j++) {
            total += servo_b[i * SERVO_INPUTS + j] * net[j];
            ahead += servo_b[i * SERVO_INPUTS + j] * wanted[j];
        }
        next[0][i] = total;
        next[1][i] = ahead;
    }
    for (i = 0; i < SERVO_STATES; i++) {
        s->state[0][i] = next[0][i];
        s->state[1][i] = next[1][i];
    }
}
"""


def c_controller(gains: ServoGains) -> str:
    """Return a C header with the controller's numbers and the functions that run it.

    ``servo_reset`` and ``servo_step`` do what `Servo.reset` and `Servo.step` do. Numbers are the
    shortest decimals that a compiler turns into the same doubles.

    Parameters
    ----------
    gains : ServoGains
        The controller.
    """
    sizes = {
        "STATES": len(gains.A),
        "INPUTS": len(gains.inputs),
        "OUTPUTS": len(gains.outputs),
        "TRACKED": len(gains.tracked),
        "LONG": int(gains.windows[0]),
        "SHORT": int(gains.windows[1]),
        "PLAN_ROWS": PLAN_ROWS,
    }
    lines = [
        f"/* {MARK}",
        f" * Servo at {gains.rate_hz:g} Hz: servo_reset, then servo_step for each sample.",
        " */",
        "#ifndef SERVO_CONTROLLER_H",
        "#define SERVO_CONTROLLER_H",
        "",
        *(f"#define SERVO_{name} {size}" for name, size in sizes.items()),
        f"#define SERVO_RATE_HZ {gains.rate_hz!r}",
        "",
    ]
    for name in ("inputs", "outputs", "tracked"):
        strings = ", ".join(map(c_string, getattr(gains, name)))
        lines.append(f"static const char *const servo_{name}[] = {{{strings}}};")
    places = ", ".join(str(gains.outputs.index(name)) for name in gains.tracked)
    lines.append(f"static const int servo_tracked_output[] = {{{places}}};")
    for name in ARRAYS:
        # No number of C is infinite everywhere; nothing reaches this one.
        finite = np.minimum(np.ravel(getattr(gains, name)), float(_BIG))
        head = f"static const double servo_{name.lower()}[] = {{"
        lines += [head, *number_lines(finite.tolist()), "};"]
    return "\n".join([*lines, _STEP.rstrip(), "", "#endif", ""])
