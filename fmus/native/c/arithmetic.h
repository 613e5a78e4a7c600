/* What the generated equations and the stepper share. */
#ifndef ARITHMETIC_H
#define ARITHMETIC_H

#include <math.h>

#define AT_LEAST_1(n) ((n) > 0 ? (n) : 1) /* C has no arrays of length zero */

/* As max(a, b) and min(a, b) of Python, also where one of them is not a number. */
static inline double larger(double a, double b) { return b > a ? b : a; }
static inline double smaller(double a, double b) { return b < a ? b : a; }

/* As a % b of Python: with the sign of b. */
static inline double modulo(double a, double b)
{
    const double rest = fmod(a, b);
    if (rest == 0.0)
        return copysign(0.0, b);
    return (rest < 0.0) != (b < 0.0) ? rest + b : rest;
}

#endif
