/* LU factors of a small matrix. */
#ifndef FACTORIZE_H
#define FACTORIZE_H

#include "system.h"

/* Replace w by its LU factors with row pivoting; 0 if it is singular. On the diagonal stand the
 * inverses of the pivots: a division takes several times as long as a product.
 *
 * `ends`, 2 n, becomes where each row of the upper factor and each column of the lower one ends, past
 * which there are zeros; null where these are too few to look for. */
INLINED int factorize(double *w, int32_t *pivots, int32_t *ends, int n)
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
                if (ends && j < k && swapped != 0.0 && ends[n + j] <= row)
                    ends[n + j] = row + 1;
            }
        }
        int end = n, below = k + 1;
        if (ends) {
            while (end > k + 1 && w[k * n + end - 1] == 0.0)
                end--;
            ends[k] = end;
        }
        const double inverse = 1.0 / w[k * n + k];
        for (int i = k + 1; i < n; i++) {
            const double factor = w[i * n + k] *= inverse;
            if (factor != 0.0) {
                for (int j = k + 1; j < end; j++)
                    w[i * n + j] -= factor * w[k * n + j];
                below = i + 1;
            }
        }
        w[k * n + k] = inverse;
        if (ends)
            ends[n + k] = below;
    }
    return 1;
}

/* Solve for the right-hand side b, in place, with the factors made by `factorize`. */
INLINED void solve_factorized(const double *w, const int32_t *pivots, const int32_t *ends, int n,
                              double *b)
{
    for (int k = 0; k < n; k++) {
        const double swapped = b[k];
        b[k] = b[pivots[k]];
        b[pivots[k]] = swapped;
    }
    for (int k = 0; k < n; k++) {
        const int below = ends ? ends[n + k] : n;
        for (int i = k + 1; i < below; i++)
            b[i] -= w[i * n + k] * b[k];
    }
    for (int k = n - 1; k >= 0; k--) {
        const int end = ends ? ends[k] : n;
        for (int j = k + 1; j < end; j++)
            b[k] -= w[k * n + j] * b[j];
        b[k] *= w[k * n + k];
    }
}

#endif
