/* Delayed signals: their values during the accepted steps.
 *
 * The delayed signals are in u, and after all of them their rates; both are written there before
 * any function of the equations is called. A step adds a piece of each signal: its values at equal
 * distances, from the stepper's dense output of order four, with a polynomial through them. No step
 * is longer than the shortest delay, so that the required values are always known, and the stepper
 * keeps its order, which is five.
 *
 * A step begins where a derivative of order L of a signal jumps, and another one begins one delay
 * later, where the derivative of order L + 1 of the states jumps: steps end at all such instants up
 * to L = SMOOTH. */
#ifndef DELAYS_H
#define DELAYS_H

#include "system.h"

#define PIECES 5      /* equal parts of a step, at whose ends a signal's values are kept */
#define SMOOTH 5      /* jumps of higher orders do not disturb a step */
#define NO_JUMP 99.0  /* level of a step that begins where nothing jumps */
#define SAME_TIME 1e-12 /* largest difference of equal instants, as a share of the time */
#define UNRESOLVED 1e-4 /* share of the shortest delay: shorter steps need not follow a signal */

/* Parts of a history: four numbers, each delay's duration, the held values of the last step, and
 * then per step its beginning, its level and the values of each signal. */
enum { ROOM, COUNT, END, DISTURBED, DURATIONS };
#define STEP_SIZE(count) (2 + (PIECES + 1) * (count))
#define HISTORY_HEAD(count, held) (DURATIONS + (count) + (held))

struct Delays {
    int32_t count, first; /* number of signals; place of the first in u */
    System plain;         /* the equations, which get u with the signals */
    double *history;      /* belongs to a motion, as its state does */
    double *told;         /* scratch: 4 count; what `delayed` writes */
    double *node;         /* scratch: as many as states */
};

/* Put delayed signals into the equations of s. */
static void lay_delays(System *s, Delays *delays, int count, int first, double *memory);
#define DELAYS_DOUBLES(n, count) (4 * (count) + (n))

/* Write the delayed signals and their rates at t into u. */
static void look_back(GIVEN);

/* Prepare steps from t0; 0 if a delay is zero. If the motion does not continue at the end of the
 * last step, its history begins again. */
static int begin_history(const System *s, double t0, const double *x, const double *u,
                         const double *p);

/* Whether there is room for one more step; steps that are older than all delays are removed. */
static int has_room(const System *s);

/* Latest end of a step from t. */
static double latest_end(const System *s, double t, double t1);

#endif
