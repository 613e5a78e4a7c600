/* Model exchange, and partial derivatives. */
#ifndef EXCHANGE_H
#define EXCHANGE_H

#include "component.h"

/* -- model exchange ----------------------------------------------------------------------- */

typedef struct {
    int states_changed;
    int next_time_defined;
    double next_time;
} Events;

/* Carry out what is due: samples, and events of the present mode. */
static Status update_discrete_states(Instance *c, Events *events)
{
    double *memory = c->memory;
    memset(events, 0, sizeof *events);
    if (stopped(c))
        return ERROR;
    if (AT_SAMPLE_TIME >= 0) {
        const double period = memory[AT_SAMPLE_TIME];
        const double now = TIME(c) + ROUND_OFF * period;
        if (!(period > 0.0 && fabs(memory[AT_SAMPLES]) < 4.5e15 &&
              (now - memory[AT_SAMPLES] * period) / period < MOST_SAMPLES))
            return fail(c, "too many sample instants are due at t = %.9g s", TIME(c));
        while (memory[AT_SAMPLES] * period <= now)
            take_sample(c, TIME(c));
        events->next_time_defined = 1;
        events->next_time = memory[AT_SAMPLES] * period;
    }
    if (EVENTS > 0) {
        const double count = INFO(c)->events;
        if (let_happen(c) != DONE)
            return fail(c, "events follow each other without end at t = %.9g s", TIME(c));
        events->states_changed = INFO(c)->events != count;
    }
    c->stale = 1;
    return OK;
}

static Status get_array(Instance *c, const double *from, size_t there, double *values, size_t n,
                        const char *what)
{
    if (n != there)
        return refuse(c, "%lu %s were asked for, there are %lu", (unsigned long)n, what,
                      (unsigned long)there);
    if (n && !values)
        return refuse(c, "a null pointer was given for %lu %s", (unsigned long)n, what);
    if (n)
        memcpy(values, from, n * sizeof *values);
    return OK;
}

static Status go_to(Instance *c, double time)
{
    if (!isfinite(time))
        return refuse(c, "the time was set to %g, not a number", time);
    set_time(c, time);
    return OK;
}

static Status get_derivatives(Instance *c, double *values, size_t n)
{
    return get_array(c, derivatives(c), N, values, n, "derivatives");
}

static Status get_states(Instance *c, double *values, size_t n)
{
    refresh(c);
    return get_array(c, STATES(c), N, values, n, "states");
}

static Status get_indicators(Instance *c, double *values, size_t n)
{
    refresh(c);
    show_indicators(c);
    return get_array(c, c->work.g, EVENTS, values, n, "event indicators");
}

static Status set_states(Instance *c, const double *values, size_t n)
{
    if (n != (size_t)N || (n && !values))
        return refuse(c, "%lu states were given%s, expected %d", (unsigned long)n,
                      values ? "" : " by a null pointer", N);
    for (int i = 0; i < N; i++) {
        if (!isfinite(values[i]))
            return refuse(c, "state %d was set to %g, not a number", i, values[i]);
    }
    if (n)
        memcpy(STATES(c), values, n * sizeof *values);
    c->stale = 1;
    return OK;
}

/* -- partial derivatives ------------------------------------------------------------------ */

/* Row of an unknown in the matrix of partial derivatives; -1 if it has none. */
static int row_of(uint32_t reference)
{
    const Variable *v = &VARIABLES[reference < (uint32_t)REFERENCES ? reference : 0];
    return v->what == DERIVATIVE ? v->place : v->what == OUTPUT ? v->place - AT_OUTPUTS + N : -1;
}

/* Column of a known, which is a state or an input; -1 if it has none. */
static int column_of(uint32_t reference)
{
    const Variable *v = &VARIABLES[reference < (uint32_t)REFERENCES ? reference : 0];
    switch (v->what) {
    case INPUT: return v->place + N;
    case STATE: return v->place - AT_STATES;
    case OUTPUT: return STATE_OF_OUTPUT[v->place - AT_OUTPUTS];
    default: return -1;
    }
}

/* Forward: sensitivities of the unknowns from seeds of the knowns; adjoint: vice versa. */
static Status derivative_product(Instance *c, int adjoint, const uint32_t *unknowns, size_t n,
                                 const uint32_t *knowns, size_t m, const double *seed,
                                 double *sensitivity)
{
    double *const by_row = c->scratch, *const by_column = by_row + N + OUTPUT_COUNT;
    double *const values = by_row + SENSITIVITIES;
    if ((n && !unknowns) || (m && !knowns) || ((adjoint ? n : m) && !seed) ||
        ((adjoint ? m : n) && !sensitivity))
        return refuse(c, "a null pointer was given for partial derivatives");
    memset(by_row, 0, SENSITIVITIES * sizeof *by_row);
    for (size_t k = 0; k < n; k++) {
        const int row = row_of(unknowns[k]);
        if (row < 0)
            return refuse(c, "value reference %lu is no output and no derivative, so it has no "
                             "partial derivatives", (unsigned long)unknowns[k]);
        if (adjoint)
            by_row[row] += seed[k];
    }
    for (size_t k = 0; k < m; k++) {
        const int column = column_of(knowns[k]);
        if (column < 0)
            return refuse(c, "value reference %lu is no input and no state, so there are no partial "
                             "derivatives by it", (unsigned long)knowns[k]);
        if (!adjoint)
            by_column[column] += seed[k];
    }
    refresh(c);
    PARTIAL(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), values);
    for (int k = 0; k < PARTIALS; k++) {
        const int row = PARTIAL_AT[k][0], column = PARTIAL_AT[k][1];
        /* derivatives that are not requested may be infinite: use only those with a seed not zero
         * */
        if (adjoint && by_row[row] != 0.0)
            by_column[column] += values[k] * by_row[row];
        else if (!adjoint && by_column[column] != 0.0)
            by_row[row] += values[k] * by_column[column];
    }
    for (size_t k = 0; k < (adjoint ? m : n); k++)
        sensitivity[k] = adjoint ? by_column[column_of(knowns[k])] : by_row[row_of(unknowns[k])];
    return OK;
}

#endif
