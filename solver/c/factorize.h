/* LU factors of a small matrix. */
#ifndef FACTORIZE_H
#define FACTORIZE_H

#include "system.h"

/* Replace w by its LU factors with row pivoting; 0 if it is singular. The diagonal has the inverses
 * of the pivots: a division takes several times as long as a product. */
INLINED int factorize(double *w, int32_t *pivots, int n)
{
    for (int k = 0; k < n; k++) {
        double best = fabs(w[k * n + k]);
        int row = k;
        for (int i = k + 1; i < n; i++) {
            if (fabs(w[i * n + k]) > best) {
                best = fabs(w[i * n + k]);
                row = i;
            }
        }
        if (!(best > 0.0) || best == HUGE_VAL)
            return 0;
        pivots[k] = row;
        if (row != k) {
            for (int j = 0; j < n; j++) {
                const double swapped = w[k * n + j];
                w[k * n + j] = w[row * n + j];
                w[row * n + j] = swapped;
            }
        }
        const double inverse = 1.0 / w[k * n + k];
        for (int i = k + 1; i < n; i++) {
            const double factor = w[i * n + k] *= inverse;
            if (factor != 0.0) {
                for (int j = k + 1; j < n; j++)
                    w[i * n + j] -= factor * w[k * n + j];
            }
        }
        w[k * n + k] = inverse;
    }
    return 1;
}

/* Solve for the right-hand side b, in place, with the factors made by `factorize`. */
INLINED void solve_factorized(const double *w, const int32_t *pivots, int n, double *b)
{
    for (int k = 0; k < n; k++) {
        const double swapped = b[k];
        b[k] = b[pivots[k]];
        b[pivots[k]] = swapped;
    }
    for (int k = 0; k < n; k++) {
        for (int i = k + 1; i < n; i++)
            b[i] -= w[i * n + k] * b[k];
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++)
            b[k] -= w[k * n + j] * b[j];
        b[k] *= w[k * n + k];
    }
}

/* One product that is subtracted when solving. */
typedef struct {
    double factor;
    int32_t to, from;
} Term;

/* The factors of a matrix with many zeros: the same numbers, but rows are not moved, and the
 * entries that are not zero are in the order of solving. */
typedef struct {
    double *inverse;     /* of each pivot */
    Term *lower, *upper; /* the upper ones from the last row to the first */
    Term *lower_end;
    int32_t *rows;   /* of the pivots */
    int32_t *counts; /* number of upper terms of each pivot's row */
    int32_t *below;  /* scratch: rows that can have the next pivot */
} Sparse;

/* As `factorize`; w is overwritten. There is room for n n terms from `lower` on. */
static int factorize_sparse(double *w, Sparse *s, int n)
{
    Term *lower = s->lower, *upper = s->lower + n * n;
    for (int i = 0; i < n; i++)
        s->rows[i] = i;
    for (int k = 0; k < n; k++) {
        double best = fabs(w[s->rows[k] * n + k]);
        int at = k, count = 0;
        for (int i = k; i < n; i++) {
            const double size = fabs(w[s->rows[i] * n + k]);
            s->below[count] = s->rows[i];
            count += size != 0.0;
            if (size > best) {
                best = size;
                at = i;
            }
        }
        if (!(best > 0.0) || best == HUGE_VAL)
            return 0;
        const int32_t row = s->rows[at];
        s->rows[at] = s->rows[k];
        s->rows[k] = row;
        const Term *const end = upper;
        for (int j = n - 1; j > k; j--) {
            const double factor = w[row * n + j];
            upper[-1] = (Term){factor, k, j};
            upper -= factor != 0.0;
        }
        s->counts[k] = (int32_t)(end - upper);
        const double inverse = s->inverse[k] = 1.0 / w[row * n + k];
        for (int i = 0; i < count; i++) {
            double *const other = w + s->below[i] * n;
            const double factor = other[k] * inverse;
            if (s->below[i] != row && factor != 0.0) {
                for (const Term *u = upper; u < end; u++)
                    other[u->from] -= factor * u->factor;
                *lower++ = (Term){factor, s->below[i], row};
            }
        }
    }
    s->lower_end = lower;
    s->upper = upper;
    return 1;
}

/* Solve for the right-hand side b, which is overwritten; the solution goes to x. */
static void solve_sparse(const Sparse *s, int n, double *b, double *x)
{
    for (const Term *l = s->lower; l < s->lower_end; l++)
        b[l->to] -= l->factor * b[l->from];
    const Term *u = s->upper;
    for (int k = n - 1; k >= 0; k--) {
        double left = b[s->rows[k]];
        for (const Term *const end = u + s->counts[k]; u < end; u++)
            left -= u->factor * x[u->from];
        x[k] = left * s->inverse[k];
    }
}

#endif
