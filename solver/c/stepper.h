/* The stiff stepper: Rodas5P (G. Steinebach, BIT Numer. Math. 63, 27 (2023)), eight stages, order
 * five with an embedded fourth-order solution, stiffly accurate, L-stable, one factorization a step,
 * with the exact Jacobian and partial derivative by time; and the location of events. */
#ifndef STEPPER_H
#define STEPPER_H

#include "factorize.h"

#define STAGES 8
#define MOST_AT_ONCE 64 /* events at one instant */
#define SMALLEST 1e-13  /* share of the time: smaller steps are too small, closer events coincide */

enum {
    DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, CHATTER, DIVERGED, STIFF, NO_MEMORY, NOT_FINITE,
    NO_ROOM, /* in a history; the call can continue where it ended, with more room */
    NO_DELAY /* a delay is zero */
};
enum { EITHER, CHANGES_MODE, RESETS }; /* kinds of events */

/* Data of an integration for the next one, and its counters. */
typedef struct {
    double next_step; /* to try first; 0: choose one */
    double accepted, rejected;
    double reached; /* time */
    double events;
    double status;
    double last_error; /* kept if a call ends at its limit of steps */
} Info;

/* Time of the last event, and number of the events without time between them. */
typedef struct {
    double last;
    int32_t count;
} Crowd;

/* Effect of the events at one instant on tangents, see `note_event`. */
typedef struct {
    int32_t any;
    double *w;        /* gradient of the first indicator over its rate */
    double *b;        /* rate of the state before, moved on by the resets */
    double *a;        /* product of the resets' slopes, n x n */
    double *gradient; /* scratch: n, n, n x n, n x n */
    double *by_time;
    double *reset;
    double *product;
} Note;

/* Scratch memory; contents do not matter between calls. Vectors of n, except where noted. */
typedef struct {
    double *jacobian, *w; /* n x n */
    double *k;            /* a row per stage */
    double *stage, *slope, *by_time, *alone, *end, *middle;
    double *first; /* rate of the state at the start of the last step */
    double *g, *before; /* as many as events */
    double *left;
    Sparse sparse;
    int32_t *pivots, *fired;
    int32_t found; /* the event that ends a step; -1 if none does */
    int32_t known; /* whether the Jacobian is already that at the start of the next integration */
    Note *note;    /* null if not needed */
} Work;

#define WORK_DOUBLES(n, events) (4 * (n) * (n) + (STAGES + 11) * (n) + 3 * (events) + 2)

/* Hermite's cubic through both ends of a step of length h, at the share q of it. */
INLINED void hermite(int n, double q, double h, const double *first, const double *slope0,
                     const double *last, const double *slope1, double *at)
{
    for (int i = 0; i < n; i++) {
        at[i] = (1.0 + 2.0 * q) * ((1.0 - q) * (1.0 - q)) * first[i] +
                q * ((1.0 - q) * (1.0 - q)) * h * slope0[i] + q * q * (3.0 - 2.0 * q) * last[i] +
                q * q * (q - 1.0) * h * slope1[i];
    }
}

/* Type of `integrate`, and of the function of the explicit pair. */
typedef int (*Integrator)(const System *s, double t0, double t1, double *x, double *u,
                          const double *p, const double *atol, double rtol, void *work, Info *info,
                          int max_steps);

#endif
