/* FMI functions on the memory of a readable FMU's slave, like those of `fmus/runtime.py`, but
 * without Python in each call; `played.py` sets them up after initialization. */
#include <stdlib.h>

#define SAME_TIME 1e-9 /* share of a sampling period within which two times are equal */
#define MOST_STEPS 200000
#define REFUSED 3 /* FMI status */

typedef struct {
    Vector memory, nominal, atol;
    Vector update; /* room for discrete states */
    Places places; /* place of each value reference in the memory */
    /* functions of the FMU's core, and their arguments */
    int (*step)(const void *, double, double, double, int);
    void (*output)(const void *, double);
    void (*sample)(const void *, double, const double *, const double *, const double *, double *);
    const void *instance, *system;
    /* places in the memory; negative if there is none */
    int64_t discrete, parameters, states, tolerance, time, samples, step_start, sample_time;
    int64_t is_new; /* whether the outputs in the memory are up to date */
    /* the error, for the slave's message: a value that is not finite, or a failed step */
    Vector before; /* the memory before the last step */
    int64_t bad_value, bad_step, reference;
    double value, t, h;
} Played;

API int played_set_real(Played *s, const uint32_t *references, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++) {
        if (!isfinite(values[k])) { /* the next step fails */
            if (!s->bad_value) {
                s->reference = references[k];
                s->value = values[k];
            }
            s->bad_value = 1;
            return 0;
        }
    }
    for (size_t k = 0; k < count; k++)
        s->memory.at[s->places.at[references[k]]] = values[k];
    s->is_new = 0;
    return 0;
}

API int played_get_real(Played *s, const uint32_t *references, size_t count, double *values)
{
    if (!s->is_new)
        s->output(s->instance, s->memory.at[s->time]);
    s->is_new = 1;
    for (size_t k = 0; k < count; k++)
        values[k] = s->memory.at[s->places.at[references[k]]];
    return 0;
}

static int advance_played(Played *s, double t, double end)
{
    return s->step(s->instance, t, end, s->memory.at[s->tolerance], MOST_STEPS) == 0;
}

static int step_played(Played *s, double t, double h)
{
    double *const memory = s->memory.at;
    double now = t;
    const double end = t + h;
    if (s->bad_value || !(h > 0.0) || !isfinite(end))
        return 0;
    if (s->step_start >= 0)
        memory[s->step_start] = t;
    if (s->sample_time >= 0) {
        const double period = memory[s->sample_time];
        int64_t index = (int64_t)memory[s->samples];
        for (; (double)index * period < end - SAME_TIME * period; index++) {
            const double instant = fmax((double)index * period, now);
            if (instant > now + SAME_TIME * period) {
                TRY(advance_played(s, now, instant));
                now = instant;
            }
            s->sample(s->system, now, memory + s->states, memory, memory + s->parameters,
                      s->update.at);
            copy(s->update.at, memory + s->discrete, s->update.size);
        }
        memory[s->samples] = (double)index;
    }
    if (s->sample_time < 0 || s->nominal.size)
        TRY(advance_played(s, now, end));
    memory[s->time] = end;
    s->is_new = 0;
    return 1;
}

API int played_do_step(Played *s, double t, double h, int no_way_back)
{
    (void)no_way_back;
    copy(s->memory.at, s->before.at, s->memory.size);
    if (step_played(s, t, h))
        return 0;
    copy(s->before.at, s->memory.at, s->memory.size);
    s->bad_step = 1;
    s->t = t;
    s->h = h;
    return REFUSED;
}

API int played_get_state(Played *s, void **state)
{
    if (!*state && !(*state = malloc((size_t)s->memory.size * sizeof(double))))
        return REFUSED;
    copy(s->memory.at, *state, s->memory.size);
    return 0;
}

API int played_set_state(Played *s, void *state)
{
    copy(state, s->memory.at, s->memory.size);
    for (int64_t k = 0; k < s->nominal.size; k++)
        s->atol.at[k] = s->nominal.at[k] * s->memory.at[s->tolerance];
    s->is_new = 0;
    return 0;
}

API int played_free_state(Played *s, void **state)
{
    (void)s;
    free(*state);
    *state = NULL;
    return 0;
}
