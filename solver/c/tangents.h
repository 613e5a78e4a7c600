/* Tangent vectors along a trajectory, orthonormalized: finite-time Lyapunov exponents.
 *
 * The trajectory is the stiff stepper's. Over each of its steps the tangents obey a linear
 * equation, whose propagator is the product of two matrix exponentials of the Jacobian
 * (commutator-free, order four: A. Alvermann and H. Fehske, J. Comput. Phys. 230, 5930 (2011), with
 * the stage values of S. Blanes and P. C. Moan, Appl. Numer. Math. 56, 1519 (2006)). An exponential
 * does not damp stiff directions as a stable step would, so the fast exponents are correct. It is
 * applied in so many equal parts that the fastest tangent stays above the round-off of the slowest,
 * with an orthonormalization after each: the parts are powers of two of one small exponential, so
 * that each costs a product of small matrices, not a step of the solver.
 *
 * For slow directions together with stiff ones, Jacobians that are constant piece by piece lose
 * order: when the slow direction turns, each piece moves a little of it into the stiff one. Slow
 * tangents can be collocated instead. The two methods cannot be mixed well, since a very small
 * change of a slow tangent changes the volume of the stiff ones very much: all tangents are
 * followed by exponentials, or the slow ones separately. */
#ifndef TANGENTS_H
#define TANGENTS_H

#include "stepper.h"

/* A sampled system has its discrete states as states with zero rates; their update is the first
 * event of every mode, which only the clock triggers. */
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
    const double *bound; /* n: a state beyond this has diverged */
    const double *scale; /* n: powers of two near the states' magnitudes */
    int32_t max_steps;
    int32_t collocating; /* whether slow tangents are collocated */
    double period;       /* of the samples, at its multiples; 0 without */
} Walk;

/* The upward crossings of a plane by a motion. */
typedef struct {
    double t0, t1;
    double *x, *u;
    const double *p, *atol;
    double rtol;
    const double *bound;
    int32_t max_steps;
    int32_t coordinate; /* the plane: where x[coordinate] is `level` */
    double level;
    int32_t most;   /* crossings; 0: none is searched, and steps are not shortened */
    double *times;  /* most */
    double *states; /* most x n */
    double *low, *high; /* n: of the states, with their extremes within steps */
    double period;      /* as in Walk; crossings are then checked from sample to sample */
} Crossings;

#endif
