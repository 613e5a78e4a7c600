/* Tangent vectors along a trajectory, orthonormalized: finite-time Lyapunov exponents.
 *
 * The trajectory is the stiff stepper's. Over each of its steps the tangents obey a linear equation,
 * whose propagator is the product of two matrix exponentials of the Jacobian (commutator-free, order
 * four: A. Alvermann and H. Fehske, J. Comput. Phys. 230, 5930 (2011), with the stage values of
 * S. Blanes and P. C. Moan, Appl. Numer. Math. 56, 1519 (2006)). An exponential does not damp what is
 * stiff as a stable step would, so the fast exponents come out right. It is applied in as many equal
 * parts as keep the fastest tangent above the round-off of the slowest, with an orthonormalization
 * after each: the parts are powers of two of one small exponential, so that they cost a product of
 * small matrices each, not a step of the solver.
 *
 * For what is slow beside something stiff, Jacobians that are constant piece by piece lose order:
 * where the slow direction turns, each piece sends a little of it into the stiff one. Slow tangents
 * can be collocated instead. The two do not mix well, since a slow tangent moved by a hair moves the
 * volume of the stiff ones by much: all tangents are followed by exponentials, or the slow ones by
 * themselves. */
#ifndef TANGENTS_H
#define TANGENTS_H

#include "stepper.h"

/* A sampled system holds its discrete states as states that stand still; their update is the first
 * event of every mode, which nothing but the clock makes happen. */
#define SAMPLE 0
#define SAME_INSTANT 1e-6 /* share of the period */

/* A motion and tangents that are to be followed over a grid of times. */
typedef struct {
    int32_t rows, count; /* times; tangents */
    const double *times;
    double *states; /* rows x n; the first row is given */
    double *growth; /* rows x count: logarithms of the tangents [nats]; the first row is given */
    double *trace;  /* rows: integral of the Jacobian's trace, and the events' log determinants */
    double *frame;  /* count x n: orthonormal tangents, a row each, in and out */
    double *u;
    const double *p;
    const double *atol;
    double rtol;
    const double *bound; /* n: a state beyond this has diverge */
    const double *scale; /* n: powers of two near the states' magnitudes */
    int32_t max_steps;
    int32_t collocating; /* whether slow tangents are collocated */
    double period;       /* of the samples, at its multiples; 0 without */
} Walk;

/* How often a motion crosses a plane upwards. */
typedef struct {
    double t0, t1;
    double *x, *u;
    const double *p, *atol;
    double rtol;
    const double *bound;
    int32_t max_steps;
    int32_t coordinate; /* the plane: where x[coordinate] is `level` */
    double level;
    int32_t most;   /* crossings; 0: none is looked for, and steps are not cut short */
    double *times;  /* most */
    double *states; /* most x n */
    double *low, *high; /* n: of the states, with their extremes within steps */
    double period;      /* as in Walk; crossings are then looked at from sample to sample */
} Crossings;

static int spectrum(const System *s, const Walk *w, Info *info);

static int explicit_spectrum(const System *s, const Walk *w, Info *info);

static int returns(const System *s, const Crossings *c, int explicitly, Info *info);

#endif
