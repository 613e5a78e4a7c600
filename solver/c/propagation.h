/* Tangent vectors pushed by a matrix exponential or by collocation, and orthonormalized. */
#ifndef PROPAGATION_H
#define PROPAGATION_H

#include "orthonormalize.h"

#define SLOW 0.3     /* largest change of a slow tangent in a part of a step, over its length */
#define MOST_PARTS 4 /* of a step in which slow tangents are collocated */

#define PROPAGATION_DOUBLES(n) (14 * (n) * (n) + 14 * (n) + 2)

/* Scratch memory of PROPAGATION_DOUBLES(n). */
typedef struct {
    double *e, *saved, *saved_logs, *row;
    double *power, *other, *below, *column;
    double *matrix, *stages; /* 3 n x 3 n, 3 n; shared with those above */
    int32_t *pivots;         /* 3 n */
} Propagation;

static void lay_propagation(Propagation *work, int n, double *memory);

static void apply(const double *matrix, double *frame, int count, int n, double *row);

static double push(double *omega, double *frame, int count, int n, double *logs, const double *scale,
            double spread, const Propagation *work);

static void collocate(const double *jacobians, double h, double *frame, int count, int n,
               const Propagation *work);

static int slow_ones(const double *jacobian, const double *frame, int count, int n, const double *scale,
              double h, double *changes);

#endif
