/* An explicit pair for systems that are not stiff: motion and tangents as one smooth system.
 *
 * The method is the eighth-order pair of Dormand and Prince with error estimates of orders five and
 * three (E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, Springer
 * 1993, Section II.10), and so is the test for steps that stability limits, not accuracy. Steps are
 * as short as motion and tangents need; the tangents are orthonormalized after each. The trace is
 * integrated together with them. If stability, or a tangent far faster than the motion, limits many
 * steps in a row, the stiff stepper is used for the motion. */
#ifndef EXPLICIT_H
#define EXPLICIT_H

#include "stepper.h"

#define EXPLICIT_ROWS 13 /* rates of a step */

/* Scratch memory; m is n + count n, the state and its tangents in one row. */
typedef struct {
    double *k;           /* EXPLICIT_ROWS x m */
    double *at, *new;    /* m */
    double *errors;      /* 2 x m */
    double *frame;       /* count x n */
    double *jacobian;    /* n x n */
    double *by_time, *logs, *bound, *scale; /* n */
    int32_t limited, others; /* steps in a row that stability limited, and others since */
} Explicit;

#define EXPLICIT_DOUBLES(n) (17 * ((n) + (n) * (n)) + 2 * (n) * (n) + 4 * (n))

static void lay_explicit(Explicit *work, int n, double *memory);

static int explicitly_on(const System *s, double t0, double t1, double *x, double *u, const double *p,
                  const double *atol, double rtol, void *work, Info *info, int max_steps);

#endif
