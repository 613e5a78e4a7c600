/* Calls of an FMU instance: through the addresses of the FMI 2.0 functions of an FMU in this
 * process, or of functions with the same signatures. */
#ifndef CALLS_H
#define CALLS_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* Arrays that are owned elsewhere, with their sizes. */
typedef struct { double *at; int64_t size; } Vector;
typedef struct { int64_t *at; int64_t size; } Places;
typedef struct { uint32_t *at; int64_t size; } References;
typedef struct { void **at; int64_t size; } Slots;

/* An FMU instance: its functions, their inputs and their outputs. */
typedef struct {
    void *component;
    int (*set_real)(void *, const uint32_t *, size_t, const double *);
    int (*get_real)(void *, const uint32_t *, size_t, double *);
    int (*do_step)(void *, double, double, int);
    int (*get_state)(void *, void **);
    int (*set_state)(void *, void *);
    int (*free_state)(void *, void **);
    References inputs;
    Vector given;
    References outputs;
    Vector taken;
    int (*ends)(void *, double, double, int); /* whether a discarded step is the last: 0 */
    double stop, end;       /* no step may end after it; or begin then, if it is not 0 [s] */
    Slots states;           /* saved states, one for each use; null if none is saved */
    int64_t status, failed; /* FMI status and kind of the call that failed */
} Calls;

enum { PUT, TAKE, MOVE, SAVE, RESTORE }; /* kinds of failed calls */

enum { WARNING = 1, DISCARD }; /* FMI status; the first counts as success, like OK */
#define TRY(call)    \
    do {             \
        if (!(call)) \
            return 0; \
    } while (0)

/* Every function here returns 1 on success, and 0 if a call failed. */
static inline int checked(Calls *c, int status, int what)
{
    if (status <= WARNING)
        return 1;
    c->status = status;
    c->failed = what;
    return 0;
}

/* Set all inputs. */
static inline int put(Calls *c)
{
    const size_t count = (size_t)c->given.size;
    return !count || checked(c, c->set_real(c->component, c->inputs.at, count, c->given.at), PUT);
}

/* Read the first outputs. */
static inline int take(Calls *c, int64_t count)
{
    return count <= 0 ||
           checked(c, c->get_real(c->component, c->outputs.at, (size_t)count, c->taken.at), TAKE);
}

#define AT_THE_END 1e-12 /* tolerance of the end time, as a share of it */

/* Whether the end is reached, so that no further step is possible. */
static inline int at_end(const Calls *c, double t) { return t >= c->stop * (1.0 - AT_THE_END); }

static inline int move(Calls *c, double t, double h)
{
    if (t + h > c->stop && t < c->stop)
        h = c->stop - t;
    /* no state from before this step will be restored */
    const int over = c->end > 0.0 && t >= c->end;
    const int status = over ? DISCARD : c->do_step(c->component, t, h, 1);
    const int last = status == DISCARD && c->ends && !c->ends(c->component, t, h, 1);
    c->end = last ? (t + h) * (1.0 - AT_THE_END) : 0.0;
    return last || checked(c, status, MOVE);
}

static inline int save(Calls *c, int64_t use)
{
    return checked(c, c->get_state(c->component, c->states.at + use), SAVE);
}

static inline int restore(Calls *c, int64_t use)
{
    return checked(c, c->set_state(c->component, c->states.at[use]), RESTORE);
}

/* Forget the state kept for a use, if there is one. */
static inline void release(Calls *c, int64_t use)
{
    if (c->states.size > use && c->states.at[use]) {
        c->free_state(c->component, c->states.at + use);
        c->states.at[use] = NULL;
    }
}

static inline int save_both(Calls *a, Calls *b, int k) { return save(a, k) && save(b, k); }
static inline int restore_both(Calls *a, Calls *b, int k) { return restore(a, k) && restore(b, k); }

static inline void release_both(Calls *a, Calls *b, int use)
{
    release(a, use);
    release(b, use);
}

static inline void copy(const double *source, double *target, int64_t count)
{
    memcpy(target, source, (size_t)count * sizeof *target);
}

/* Read all outputs. */
static inline int take_all(Calls *c, double *values)
{
    TRY(take(c, c->taken.size));
    copy(c->taken.at, values, c->taken.size);
    return 1;
}

#endif
