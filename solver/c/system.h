/* One system of equations dx/dt = f(t, x, u, p) with events, as the solvers see it. */
#ifndef SYSTEM_H
#define SYSTEM_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef struct System System;
typedef struct Delays Delays;

/* Where a function of a system is computed. */
#define GIVEN const System *s, double t, const double *x, const double *u, const double *p

/* Sizes, and the functions that are generated for a component. All vectors are owned by the caller.
 *
 * x: states. u: held inputs, discrete states, and the mode, which events change. p: parameters.
 * A mode's event indicators g are positive where an event is due. */
struct System {
    int32_t states;
    int32_t held;   /* length of u */
    int32_t events; /* in the mode with the most events */
    const void *equations;  /* for those functions that need more than their arguments */
    void (*rhs)(GIVEN, double *dx);
    void (*jac)(GIVEN, double *J, double *ft); /* J by x, row by row, and ft by t */
    void (*out)(GIVEN, double *y);
    void (*sample)(GIVEN, double *d);
    void (*indicate)(GIVEN, double *g);
    int (*kind)(const System *s, const double *u, int k);
    void (*react)(const System *s, double t, double *x, double *u, const double *p, int k);
    /* gradient of an indicator, slopes of its reset by x and by t; returns the indicator's by t */
    double (*slopes)(GIVEN, int k, double *gradient, double *R, double *Rt);
    /* for each delayed signal: the expression, its delay, its start and its nominal value */
    void (*delayed)(GIVEN, double *e);
    Delays *delays; /* null without */
};

/* Give this pointer of `own` the next part, of so many numbers, of the memory from `next` on. */
#define TAKE(pointer, count) (own->pointer = (void *)next, next += (count))

/* A small number of states is a constant for the compiler, so that short loops are unrolled. */
#if defined(__GNUC__)
#define INLINED static inline __attribute__((always_inline))
#else
#define INLINED static inline
#endif

/* A function whose last argument is the number of states, of a system with so many. */
#define UNROLLED(function, states, ...)                \
    switch (states) {                                  \
    case 1: return function(__VA_ARGS__, 1);           \
    case 2: return function(__VA_ARGS__, 2);           \
    case 3: return function(__VA_ARGS__, 3);           \
    case 4: return function(__VA_ARGS__, 4);           \
    case 5: return function(__VA_ARGS__, 5);           \
    case 6: return function(__VA_ARGS__, 6);           \
    default: return function(__VA_ARGS__, states);     \
    }

/* An argument of a function, and the function's value there; NaN before the first use. */
typedef struct {
    double at, value;
} Known;

/* f(x), computed only if x differs from the last one, in any bit: a controller with the plant's own
 * parameters needs the same values as the plant. */
static inline double known(double (*f)(double), Known *k, double x)
{
    if (memcmp(&k->at, &x, sizeof x) != 0) {
        k->at = x;
        k->value = f(x);
    }
    return k->value;
}

/* As max(a, b) and min(a, b) of Python, also for NaN. */
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
