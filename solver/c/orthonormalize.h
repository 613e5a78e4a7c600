/* Tangent vectors, a row each, orthonormalized in their order. */
#ifndef ORTHONORMALIZE_H
#define ORTHONORMALIZE_H

#include "system.h"

#define COLLAPSED 1e-13 /* share of a tangent's length: with less left, its own direction is lost */

/* Remove the directions of the rows before it from row j; return the square of its remaining
 * length. */
static double free_of_others(double *frame, int j, int n)
{
    double *const own = frame + j * n;
    for (int k = 0; k < j; k++) {
        const double *const other = frame + k * n;
        double dot = 0.0;
        for (int i = 0; i < n; i++)
            dot += other[i] * own[i];
        for (int i = 0; i < n; i++)
            own[i] -= dot * other[i];
    }
    double square = 0.0;
    for (int i = 0; i < n; i++)
        square += own[i] * own[i];
    return square;
}

/* Set row j to any direction that is orthogonal to the rows before it. */
static void any_other(double *frame, int j, int n)
{
    double *const own = frame + j * n;
    for (int axis = 0; axis < n; axis++) {
        for (int i = 0; i < n; i++)
            own[i] = i == axis ? 1.0 : 0.0;
        free_of_others(frame, j, n);
        const double square = free_of_others(frame, j, n); /* the second time for round-off */
        if (square > 0.5 / n) {
            for (int i = 0; i < n; i++)
                own[i] /= sqrt(square);
            return;
        }
    }
}

/* Orthonormalize the rows of `frame` in order and add the logarithms of their remaining lengths. A
 * row without a remaining direction of its own is moved behind all others, with any other direction
 * and minus infinity: growing rows have to stay before lost ones. Returns the difference between
 * the largest and the smallest of the logarithms [nats]; collapsed rows do not count. */
static double orthonormalize(double *frame, int count, int n, double *logs)
{
    double low = HUGE_VAL, high = -HUGE_VAL;
    int left = count;
    for (int j = 0; j < left;) {
        double *const own = frame + j * n;
        double before = 0.0;
        for (int i = 0; i < n; i++)
            before += own[i] * own[i];
        const double square = free_of_others(frame, j, n);
        if (square > COLLAPSED * COLLAPSED * before) {
            const double length = sqrt(square), growth = log(length);
            logs[j] += growth;
            low = smaller(low, growth);
            high = larger(high, growth);
            for (int i = 0; i < n; i++)
                own[i] /= length;
            j++;
        } else {
            left--;
            memmove(own, own + n, (size_t)((count - 1 - j) * n) * sizeof *own);
            memmove(logs + j, logs + j + 1, (size_t)(count - 1 - j) * sizeof *logs);
            logs[count - 1] = -HUGE_VAL;
        }
    }
    for (int j = left; j < count; j++)
        any_other(frame, j, n);
    return high >= low ? high - low : 0.0;
}

#endif
