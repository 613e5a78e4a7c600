/* The stiff stepper: Rodas5P (G. Steinebach, BIT Numer. Math. 63, 27 (2023)), eight stages, order
 * five with an embedded fourth-order solution, stiffly accurate, L-stable, one factorization a step,
 * with the exact Jacobian and partial derivative by time; and the location of events. */
#ifndef STEPPER_H
#define STEPPER_H

#include "delays.h"
#include "factorize.h"

#define STAGES 8
#define MOST_AT_ONCE 64 /* events at one instant */
#define SMALLEST 1e-13  /* share of the time below which a step is too small, and events meet */

enum {
    DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, CHATTER, DIVERGED, STIFF, NO_MEMORY, NOT_FINITE,
    NO_ROOM, /* in a history; the call can go on from where it ended, with more room */
    NO_DELAY /* a delay lasts no time */
};
enum { EITHER, CHANGES_MODE, RESETS }; /* kinds of events */

/* What an integration leaves for the next, and what it has counted. */
typedef struct {
    double next_step; /* to try first; 0: choose one */
    double accepted, rejected;
    double reached; /* time */
    double events;
    double status;
    double last_error; /* kept where a call ends for want of steps */
} Info;

/* The last event and how many before it no time lies between. */
typedef struct {
    double last;
    int32_t count;
} Crowd;

/* What the events at one instant do to tangents, see `note_event`. */
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

/* Scratch memory; contents do not matter between calls. Vectors of n, but where it says more. */
typedef struct {
    double *jacobian, *w; /* n x n */
    double *k;            /* a row per stage */
    double *stage, *slope, *by_time, *alone, *end, *middle;
    double *first; /* rate of the state where the last step began */
    double *g, *before; /* as many as events */
    double *left;
    Sparse sparse;
    int32_t *pivots, *fired;
    int32_t found; /* the event that ends a step; -1 if none does */
    int32_t known; /* whether the Jacobian is already that where the next integration begins */
    Note *note;    /* null where nobody asks */
} Work;

/* Who is told of every accepted step: of its time t and of the time t1 where the integration is to
 * end. The answer is where it shall end, t at the earliest. The states are to be looked at only. */
typedef struct {
    double (*end)(void *owner, double t, double t1);
    void *owner;
} Watcher;

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

/* Lay scratch memory out in an array of WORK_DOUBLES(states, events). */
static void lay_work(Work *work, int n, int events, double *memory);

static int settle(const System *s, double t, double *x, double *u, const double *p, Work *work,
           Info *info);

/* Keep the indicators' signs at the start of a step. */
static void look_before(const System *s, double t, const double *x, const double *u, const double *p,
                 double *before);

/* As `integrate` and the pythonfmu build of the explicit pair, without a watcher. */
typedef int (*Integrator)(const System *s, double t0, double t1, double *x, double *u,
                          const double *p, const double *atol, double rtol, void *work, Info *info,
                          int max_steps);

static int integrate(const System *s, double t0, double t1, double *x, double *u, const double *p,
              const double *atol, double rtol, Work *work, Info *info, int max_steps,
              const Watcher *watcher);

#endif
