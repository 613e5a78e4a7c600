/* A component for any version of FMI: life cycle, variables and steps of co-simulation. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include "events.h"

/* -- life cycle --------------------------------------------------------------------------- */

static void initialize_states(Instance *c)
{
    double *memory = c->memory;
    memcpy(STATES(c), memory + AT_STARTS, N * sizeof *memory);
    memcpy(HELD(c) + INPUTS, memory + AT_STARTS + N, DISCRETE * sizeof *memory);
    scale_tolerances(c);
    memset(INFO(c), 0, sizeof(Info));
    if (DELAYS > 0)
        c->history[COUNT] = 0.0;
    if (MODES > 0) {
        memory[HELD_SIZE - 1] = 0.0;
        if (settle(EQUATIONS(c), TIME(c), STATES(c), HELD(c), PARAMETERS(c), &c->work, INFO(c)) !=
            DONE)
            fail(c, "events follow each other without end at t = %.9g s", TIME(c));
    }
    if (AT_SAMPLE_TIME >= 0) /* samples count from t = 0, also if the run begins later */
        memory[AT_SAMPLES] = ceil(TIME(c) / memory[AT_SAMPLE_TIME] - ROUND_OFF);
}

static void refresh(Instance *c)
{
    if (!c->stale)
        return;
    if (!c->now->started)
        initialize_states(c);
    take_frame(c);
    EQUATIONS(c)->out(EQUATIONS(c), TIME(c), STATES(c), HELD(c), PARAMETERS(c), OUTPUTS(c));
    c->stale = 0;
    c->derived = 0;
}

static const double *derivatives(Instance *c)
{
    refresh(c);
    if (!c->derived)
        EQUATIONS(c)->rhs(EQUATIONS(c), TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->derivatives);
    c->derived = 1;
    return c->derivatives;
}

static Status enter(Instance *c, Phase phase)
{
    c->now->phase = phase;
    return OK;
}

static Status back_to_start(Instance *c)
{
    memset(c->now, 0, SAVED_BYTES);
    memcpy(c->memory, INITIAL, MEMORY * sizeof *c->memory);
    c->stale = 1;
    return enter(c, INSTANTIATED);
}

static void free_instance(Instance *c)
{
    if (!c)
        return;
    while (c->kept) {
        Kept *next = c->kept->next;
        free(c->kept->history);
        free(c->kept);
        c->kept = next;
    }
    free(c->history);
    free(c->name);
    free(c);
}

static Instance *make_instance(const char *name, int exchange)
{
    const size_t scratch = DISCRETE + SENSITIVITIES + PARTIALS, signals = DELAYS_DOUBLES(N, DELAYS);
    const size_t size = SAVED_DOUBLES + 2 * N + scratch + signals + WORK_DOUBLES(N, EVENTS);
    Instance *c = calloc(1, sizeof *c + size * sizeof(double)), *own = c;
    if (!c)
        return NULL;
    double *next = (double *)(c + 1);
    TAKE(now, SAVED_DOUBLES), TAKE(derivatives, N), TAKE(atol, N), TAKE(signals, signals);
    TAKE(scratch, scratch), lay_work(&c->work, N, EVENTS, next);
    c->memory = (double *)(c->now + 1);
    c->watch = (Watch *)(c->memory + MEMORY);
    c->exchange = exchange;
    c->name = malloc(strlen(name) + 1);
    if (!c->name || !remember(c, NULL, FIRST_ROOM)) {
        free_instance(c);
        return NULL;
    }
    strcpy(c->name, name);
    c->system = SYSTEM;
    if (DELAYS > 0)
        lay_delays(&c->system, &c->delays, DELAYS, INPUTS + DISCRETE, c->signals);
    back_to_start(c);
    return c;
}

static Status begin(Instance *c, int has_tolerance, double tolerance, double start)
{
    if (!isfinite(start) || (has_tolerance && !isfinite(tolerance)))
        return refuse(c, "the start time %g and the tolerance %g make no sense", start, tolerance);
    set_time(c, start);
    if (has_tolerance && tolerance != 0.0 && N + DELAYS > 0)
        c->memory[AT_TOLERANCE] = tolerance;
    return OK;
}

static Status end_initialization(Instance *c)
{
    const int failed = c->now->failure[0];
    for (int r = 0; r < REFERENCES; r++) {
        const Variable *v = &VARIABLES[r];
        const double value = v->what == PARAMETER ? c->memory[v->place] : 0.0;
        if (v->what == PARAMETER && (value < v->low || value > v->high))
            fail(c, "parameter %s = %g%s%s is out of its range [%g, %g]", v->name, value,
                 strcmp(v->unit, "1") ? " " : "", strcmp(v->unit, "1") ? v->unit : "", v->low,
                 v->high);
    }
    initialize_states(c);
    if (EVENTS > 0 && c->exchange) {
        memset(c->work.fired, 1, (size_t)EVENTS * sizeof *c->work.fired); /* all that was due */
        watch_mode(c);
        watch_on(c, c->work.fired);
    }
    c->now->started = 1;
    c->stale = 1;
    c->now->phase = c->exchange ? EVENT : STEPPING;
    if (failed)
        say(c, ERROR, c->now->failure);
    return c->now->failure[0] ? ERROR : OK;
}

/* -- variables ---------------------------------------------------------------------------- */

static const Variable *variable(Instance *c, uint32_t reference)
{
    if (reference < (uint32_t)REFERENCES && VARIABLES[reference].what != NOTHING)
        return &VARIABLES[reference];
    refuse(c, "no variable has the value reference %lu", (unsigned long)reference);
    return NULL;
}

static Status get_numbers(Instance *c, const uint32_t *references, size_t n, double *values)
{
    if (n && (!references || !values))
        return refuse(c, "a null pointer was given for %lu values", (unsigned long)n);
    refresh(c);
    for (size_t k = 0; k < n; k++) {
        const Variable *v = variable(c, references[k]);
        if (!v)
            return ERROR;
        if (v->what == MESSAGE)
            return refuse(c, "%s is a String, not a number", v->name);
        if (v->what == DERIVATIVE) {
            values[k] = derivatives(c)[v->place];
        } else if (v->what == INDICATOR) {
            show_indicators(c);
            values[k] = c->work.g[v->place];
        } else {
            values[k] = c->memory[v->place];
        }
    }
    return OK;
}

/* Why it cannot continue, the only String. */
static Status get_failure(Instance *c, const uint32_t *references, size_t n, const char **values)
{
    if (n && (!references || !values))
        return refuse(c, "a null pointer was given for %lu values", (unsigned long)n);
    for (size_t k = 0; k < n; k++) {
        if (references[k] != (uint32_t)MESSAGE_REFERENCE)
            return refuse(c, "no String has the value reference %lu", (unsigned long)references[k]);
        values[k] = c->now->failure;
    }
    return OK;
}

/* Place of a continuous state that a host may set now through this variable, in model exchange;
 * NULL if there is none. */
static double *settable_state(Instance *c, const Variable *v)
{
    const int shown = v->what == OUTPUT ? STATE_OF_OUTPUT[v->place - AT_OUTPUTS] : -1;
    if (!c->exchange || !(c->now->phase & (EVENT | CONTINUOUS)))
        return NULL;
    if (v->what == STATE)
        return c->memory + v->place;
    return shown < 0 ? NULL : STATES(c) + shown;
}

static Status set_numbers(Instance *c, const uint32_t *references, size_t n, const double *values)
{
    if (n && (!references || !values))
        return refuse(c, "a null pointer was given for %lu values", (unsigned long)n);
    for (size_t k = 0; k < n; k++) {
        const Variable *v = variable(c, references[k]);
        if (!v)
            return ERROR;
        if (v->what != INPUT && v->what != PARAMETER && !settable_state(c, v))
            return refuse(c, "%s cannot be set; it is not an input or a parameter", v->name);
        if (v->what == PARAMETER && c->now->started)
            return refuse(c, "parameter %s cannot be set any more; set it before initialization ends",
                          v->name);
        if (!isfinite(values[k])) /* a host that tries states can try another one */
            return (settable_state(c, v) ? refuse : fail)(c, "%s was set to %g, not a number",
                                                          v->name, values[k]);
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *v = &VARIABLES[references[k]];
        double *state = settable_state(c, v);
        *(state ? state : c->memory + v->place) = values[k];
    }
    c->stale = 1;
    return OK;
}

/* -- steps of co-simulation --------------------------------------------------------------- */

static Status advance(Instance *c, double t0, double t1)
{
    int status = NO_ROOM;
    for (double from = t0; status == NO_ROOM; from = INFO(c)->reached) {
        status = integrate(EQUATIONS(c), from, t1, STATES(c), HELD(c), PARAMETERS(c), c->atol,
                           c->memory[AT_TOLERANCE], &c->work, INFO(c), MAX_STEPS);
        if (status == NO_ROOM && !remember(c, c->history, 2.0 * c->history[ROOM]))
            return fail(c, "there is no memory for what delayed signals were");
    }
    const double reached = INFO(c)->reached;
    const char *rest = "the solution diverges";
    switch (status) {
    case DONE:
        return OK;
    case TOO_MANY_STEPS:
        return fail(c, "%d internal steps were not enough at t = %.9g s; %s", MAX_STEPS, reached,
                    rest);
    case CHATTER:
        return fail(c, "events follow each other without end at t = %.9g s", reached);
    case NO_DELAY:
        return fail(c, "a delay is 0 s; expected more than 0 s");
    default:
        return fail(c, "the internal step became too small at t = %.9g s; %s", reached, rest);
    }
}

/* Update the discrete states, at a sample instant. */
static void take_sample(Instance *c, double t)
{
    EQUATIONS(c)->sample(EQUATIONS(c), t, STATES(c), HELD(c), PARAMETERS(c), c->scratch);
    memcpy(HELD(c) + INPUTS, c->scratch, DISCRETE * sizeof *c->scratch);
    c->memory[AT_SAMPLES] += 1.0;
}

/* Update the discrete states at every sample instant in [t0, c->end). */
static Status advance_sampled(Instance *c, double t0)
{
    const double period = c->memory[AT_SAMPLE_TIME];
    double now = t0;
    double *samples = &c->memory[AT_SAMPLES];
    if (!(period > 0.0 && fabs(*samples) < 4.5e15 &&
          (c->end - *samples * period) / period < MOST_SAMPLES))
        return fail(c, "a step from t = %.9g s by %.9g s holds too many sample instants", t0,
                    c->end - t0);
    while (*samples * period < c->end - ROUND_OFF * period) {
        const double instant = larger(*samples * period, now);
        if (instant > now + ROUND_OFF * period) {
            if (advance(c, now, instant) != OK)
                return ERROR;
            now = instant;
        }
        take_sample(c, now);
    }
    return N + DELAYS > 0 ? advance(c, now, c->end) : OK;
}

/* Whether it failed before and cannot continue; if so, report the reason again. */
static int stopped(Instance *c)
{
    if (c->now->failure[0])
        say(c, ERROR, c->now->failure);
    return c->now->failure[0] != 0;
}

static Status take_step(Instance *c, double t, double step)
{
    Status status;
    if (stopped(c))
        return ERROR;
    if (!(step > 0.0) || !isfinite(t + step))
        return fail(c, "a step from t = %g s by %g s is invalid", t, step);
    take_frame(c);
    if (STEP_START >= 0)
        c->memory[STEP_START] = t;
    c->end = t + step;
    status = AT_SAMPLE_TIME < 0 ? advance(c, t, c->end) : advance_sampled(c, t);
    TIME(c) = c->end;
    c->stale = 1;
    for (int i = 0; i < N && status == OK; i++) {
        if (!isfinite(STATES(c)[i]))
            status = fail(c, "the state is not finite at t = %.9g s", c->end);
    }
    return status;
}

#endif
