/* One instance of a component, for any version of FMI: its memory, life cycle, step and saved
 * states. Included once, by fmi2.c or fmi3.c, after model.h and equations.h.
 *
 * There are no globals. All numbers of an instance are in one array, as in the FMU that pythonfmu
 * makes of the same component; VARIABLES has the place of the number of each value reference. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "stepper.c"

#define AT_LEAST_1(n) ((n) > 0 ? (n) : 1) /* C has no arrays of length zero */
#define ROUND_OFF 1e-9    /* share of a sampling period within which two times are equal */
#define MAX_STEPS 200000
#define MOST_SAMPLES 1e6  /* sample instants in one step */
#define LONGEST_TEXT 512
/* share of the change of an indicator when states and inputs change by their nominals */
#define MARGIN 1e-12
#define LEAST_MARGIN 1e-300

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status; /* the same in FMI 2 and FMI 3 */

/* Phases of an instance's life, as bits, so that a function can list its allowed phases. */
typedef enum {
    INSTANTIATED = 1,
    INITIALIZING = 2,
    STEPPING = 4,    /* co-simulation, between steps */
    EVENT = 8,       /* model exchange */
    CONTINUOUS = 16, /* model exchange */
    TERMINATED = 32
} Phase;
#define RUNNING (STEPPING | EVENT | CONTINUOUS)
#define ALIVE (INSTANTIATED | INITIALIZING | RUNNING)
#define ANY (ALIVE | TERMINATED)

/* The watch of an event indicator g in model exchange: the host sees g - level. Before an event,
 * this is at least half the margin away from zero, so that neither round-off in the states nor the
 * error of the host's event time can hide or create an event. For events in both directions, the
 * level is positive while g is low, negative while it is high. */
typedef struct {
    double level;
    double margin;
    int32_t undecided; /* both directions: g was zero, and its side is not known yet */
    int32_t padding;
} Watch;

/* Everything that determines how an instance continues. */
typedef struct {
    double memory[MEMORY];
    Watch watch[AT_LEAST_1(EVENTS)]; /* model exchange */
    int32_t phase;
    int32_t started; /* initialization is over */
    char failure[LONGEST_TEXT]; /* why it cannot continue; empty without a failure */
} Saved;

typedef struct Kept {
    struct Kept *next;
    Saved saved;
    double *history; /* null without delays */
} Kept;

typedef struct Instance {
    Saved now;
    int exchange; /* for model exchange, not co-simulation */
    int stale;    /* outputs do not belong to the present state and inputs */
    int derived;  /* derivatives belong to the present outputs */
    double derivatives[AT_LEAST_1(N)];
    double atol[AT_LEAST_1(N)];
    System system; /* with delays: the equations, which read the history */
    Delays delays;
    double signals[DELAYS_DOUBLES(N, DELAYS) + 1];
    double *history; /* null without delays */
    Work work;
    double work_memory[WORK_DOUBLES(N, EVENTS)];
    Kept *kept; /* saved states that are not freed yet */
    char *name;
    void *environment;
    void (*log)(const struct Instance *, Status, const char *category, const char *text);
    void (*logger)(void); /* the host's, of a type that the FMI layer knows */
    double end;           /* of the present step of co-simulation */
} Instance;

/* -- messages ----------------------------------------------------------------------------- */

static void say(Instance *c, Status status, const char *text)
{
    if (c->log)
        c->log(c, status, "logStatusError", text);
}

static void put(char *text, const Instance *c, const char *format, va_list values)
{
    const int used = snprintf(text, LONGEST_TEXT, "%.200s: ", c->name);
    vsnprintf(text + used, (size_t)(LONGEST_TEXT - used), format, values);
}

/* Refuse an invalid call; the instance is not changed. */
static Status refuse(Instance *c, const char *format, ...)
{
    char text[LONGEST_TEXT] = "";
    va_list values;
    va_start(values, format);
    put(text, c, format, values);
    va_end(values);
    say(c, ERROR, text);
    return ERROR;
}

/* Stop the instance until it is reset or set to a saved state; the first reason is kept. */
static Status fail(Instance *c, const char *format, ...)
{
    char text[LONGEST_TEXT] = "";
    va_list values;
    va_start(values, format);
    put(text, c, format, values);
    va_end(values);
    if (!c->now.failure[0])
        memcpy(c->now.failure, text, sizeof text);
    say(c, ERROR, text);
    return ERROR;
}

static const char *phase_name(int phase)
{
    switch (phase) {
    case INSTANTIATED: return "before initialization";
    case INITIALIZING: return "in initialization mode";
    case STEPPING: return "between steps of co-simulation";
    case EVENT: return "in event mode";
    case CONTINUOUS: return "in continuous-time mode";
    default: return "after the end";
    }
}

static int allowed(Instance *c, int phases, const char *call)
{
    if (c->now.phase & phases)
        return 1;
    refuse(c, "%s was called %s, where it is not allowed", call, phase_name(c->now.phase));
    return 0;
}

/* -- delayed signals ---------------------------------------------------------------------- */

#define EQUATIONS(c) (DELAYS > 0 ? (const System *)&(c)->system : &SYSTEM)
#define FIRST_ROOM 32 /* steps */
#define HISTORY_BYTES(room)                                                                        \
    ((HISTORY_HEAD(DELAYS, HELD_SIZE) + (size_t)(room) * STEP_SIZE(DELAYS)) * sizeof(double))

static size_t bytes_of(const double *history)
{
    return DELAYS > 0 ? HISTORY_BYTES(history[ROOM]) : 0;
}

/* Copy `from`, or nothing if it is null, into a history with room for this number of steps; 0 if
 * there is not enough memory. */
static int take_history(double **history, const double *from, double room)
{
    double *taken;
    if (DELAYS == 0)
        return 1;
    if (from && *history && (*history)[ROOM] == room) {
        memcpy(*history, from, HISTORY_BYTES(room));
        return 1;
    }
    taken = calloc(1, HISTORY_BYTES(room));
    if (!taken)
        return 0;
    if (from)
        memcpy(taken, from, bytes_of(from));
    taken[ROOM] = room;
    free(*history);
    *history = taken;
    return 1;
}

/* As above, for the instance's own history. */
static int remember(Instance *c, const double *from, double room)
{
    const int done = take_history(&c->history, from, room);
    c->delays.history = c->history;
    return done;
}

/* -- parts of the memory ------------------------------------------------------------------ */

#define HELD(c) ((c)->now.memory)
#define PARAMETERS(c) ((c)->now.memory + AT_PARAMETERS)
#define STATES(c) ((c)->now.memory + AT_STATES)
#define OUTPUTS(c) ((c)->now.memory + AT_OUTPUTS)
#define INFO(c) ((Info *)((c)->now.memory + AT_INFO))
#define TIME(c) ((c)->now.memory[AT_TIME])

static void set_time(Instance *c, double t)
{
    TIME(c) = t;
    /* model exchange has no communication steps: a feedback law's step always begins now */
    if (c->exchange && STEP_START >= 0)
        c->now.memory[STEP_START < 0 ? 0 : STEP_START] = t;
    c->stale = 1;
}

static void scale_tolerances(Instance *c)
{
    for (int i = 0; i < N; i++)
        c->atol[i] = NOMINAL[i] * c->now.memory[AT_TOLERANCE];
}

/* Set tangents from their inputs, if a new frame is requested. */
static void take_frame(Instance *c)
{
#ifdef FRAME_ASK
    double *memory = c->now.memory;
    if (memory[FRAME_ASK] != memory[FRAME_SEEN]) {
        memory[FRAME_SEEN] = memory[FRAME_ASK];
        memcpy(memory + FRAME_TO, memory + FRAME_FROM, FRAME_COUNT * sizeof *memory);
    }
#else
    (void)c;
#endif
}

/* -- events of model exchange ------------------------------------------------------------- */

static double margin_of(double spread) { return MARGIN * spread + LEAST_MARGIN; }

/* Distance of an indicator beyond its event; negative before the event. */
static double past(const Watch *w, double g) { return w->level < 0.0 ? w->level - g : g - w->level; }

/* Begin to watch the events of a new mode: those beyond zero are due immediately. */
static void watch_mode(Instance *c)
{
    spread(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++) {
        const double margin = margin_of(c->work.g[k]);
        c->now.watch[k] = (Watch){margin, margin, 1, 0};
    }
}

/* The event that is due; -1 if there is none. `fired` are resets that have happened already. */
static int due_now(Instance *c, const int *fired)
{
    indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++) {
        const Watch *w = &c->now.watch[k];
        if (!fired[k] && past(w, c->work.g[k]) > -0.5 * w->margin)
            return k;
    }
    return -1;
}

/* Continue to watch from here, with every indicator away from zero. An indicator that stays
 * positive after its event has to rise further, or to fall and rise again. */
static void watch_on(Instance *c, const int *fired)
{
    indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    spread(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.before);
    for (int k = 0; k < EVENTS; k++) {
        Watch *w = &c->now.watch[k];
        const double g = c->work.g[k], margin = margin_of(c->work.before[k]);
        const double most = fired[k] ? HUGE_VAL : w->level;
        if (kind(&SYSTEM, HELD(c), k) != EITHER) {
            w->level = larger(margin, smaller(most, g + margin));
        } else if (fabs(g) > 0.5 * margin) {
            w->level = g > 0.0 ? -margin : margin;
            w->undecided = 0;
        } else {
            w->level = w->level < 0.0 ? -margin : margin;
        }
        w->margin = margin;
    }
}

/* Carry out every event that is due at this instant; return DONE or CHATTER. */
static int let_happen(Instance *c)
{
    int fired[AT_LEAST_1(EVENTS)] = {0};
    for (int round = 0; round < MOST_AT_ONCE; round++) {
        const double mode = MODES > 0 ? HELD(c)[HELD_SIZE - 1] : 0.0;
        const int k = due_now(c, fired);
        if (k < 0) {
            watch_on(c, fired);
            return DONE;
        }
        const int what = kind(&SYSTEM, HELD(c), k);
        Watch *w = &c->now.watch[k];
        if (what == EITHER) {
            const int decided = !w->undecided;
            w->level = -w->level;
            w->undecided = 0;
            if (!decided)
                continue;
        }
        react(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), k);
        INFO(c)->events += 1;
        fired[k] = what == RESETS;
        if (what == CHANGES_MODE || (MODES > 0 && HELD(c)[HELD_SIZE - 1] != mode)) {
            memset(fired, 0, sizeof fired);
            watch_mode(c);
        }
    }
    return CHATTER;
}

/* Put the indicators, as the host sees them, into work.g. */
static void show_indicators(Instance *c)
{
    indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++)
        c->work.g[k] -= c->now.watch[k].level;
}

/* After a step of the host: whether an event is due that the host has not found. */
static int complete_step(Instance *c)
{
    int missed = 0;
    if (EVENTS == 0)
        return 0;
    indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++) {
        Watch *w = &c->now.watch[k];
        const double g = c->work.g[k];
        missed |= past(w, g) >= 0.0;
        if (kind(&SYSTEM, HELD(c), k) != EITHER)
            w->level = larger(w->margin, smaller(w->level, g + w->margin));
        else if (g < -0.5 * w->margin && w->level > 0.0)
            w->undecided = 0;
    }
    return missed;
}

/* -- life cycle --------------------------------------------------------------------------- */

static void initialize_states(Instance *c)
{
    double *memory = c->now.memory;
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
        memory[AT_SAMPLES] =
            ceil(TIME(c) / memory[AT_SAMPLE_TIME < 0 ? 0 : AT_SAMPLE_TIME] - ROUND_OFF);
}

static void refresh(Instance *c)
{
    if (!c->stale)
        return;
    if (!c->now.started)
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

static Status back_to_start(Instance *c)
{
    memset(&c->now, 0, sizeof c->now);
    memcpy(c->now.memory, INITIAL, sizeof c->now.memory);
    c->now.phase = INSTANTIATED;
    c->stale = 1;
    return OK;
}

static Status enter(Instance *c, Phase phase)
{
    c->now.phase = phase;
    return OK;
}

static Instance *make_instance(const char *name, int exchange)
{
    Instance *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    lay_work(&c->work, N, EVENTS, c->work_memory);
    c->name = malloc(strlen(name) + 1);
    if (!c->name) {
        free(c);
        return NULL;
    }
    strcpy(c->name, name);
    c->exchange = exchange;
    if (!remember(c, NULL, FIRST_ROOM)) {
        free(c->name);
        free(c);
        return NULL;
    }
    if (DELAYS > 0) {
        c->system = SYSTEM;
        lay_delays(&c->system, &c->delays, DELAYS, INPUTS + DISCRETE, c->signals);
    }
    back_to_start(c);
    return c;
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

static Status begin(Instance *c, int has_tolerance, double tolerance, double start)
{
    if (!isfinite(start) || (has_tolerance && !isfinite(tolerance)))
        return refuse(c, "the start time %g and the tolerance %g make no sense", start, tolerance);
    set_time(c, start);
    if (has_tolerance && tolerance != 0.0 && N + DELAYS > 0)
        c->now.memory[AT_TOLERANCE] = tolerance;
    return OK;
}

static Status end_initialization(Instance *c)
{
    const int failed = c->now.failure[0];
    for (int r = 0; r < REFERENCES; r++) {
        const Variable *v = &VARIABLES[r];
        const double value = v->what == PARAMETER ? c->now.memory[v->place] : 0.0;
        if (v->what == PARAMETER && (value < v->low || value > v->high))
            fail(c, "parameter %s = %g%s%s is out of its range [%g, %g]", v->name, value,
                 strcmp(v->unit, "1") ? " " : "", strcmp(v->unit, "1") ? v->unit : "", v->low,
                 v->high);
    }
    initialize_states(c);
    if (EVENTS > 0 && c->exchange) {
        int fired[AT_LEAST_1(EVENTS)]; /* all due events have happened */
        for (int k = 0; k < EVENTS; k++)
            fired[k] = 1;
        watch_mode(c);
        watch_on(c, fired);
    }
    c->now.started = 1;
    c->stale = 1;
    c->now.phase = c->exchange ? EVENT : STEPPING;
    if (failed)
        say(c, ERROR, c->now.failure);
    return c->now.failure[0] ? ERROR : OK;
}

/* -- variables ---------------------------------------------------------------------------- */

static const Variable *variable(Instance *c, uint32_t reference)
{
    if (reference < REFERENCES && VARIABLES[reference].what != NOTHING)
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
            values[k] = c->now.memory[v->place];
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
        if (references[k] != MESSAGE_REFERENCE)
            return refuse(c, "no String has the value reference %lu", (unsigned long)references[k]);
        values[k] = c->now.failure;
    }
    return OK;
}

/* Place of a continuous state that a host may set now through this variable, in model exchange;
 * NULL if there is none. */
static double *settable_state(Instance *c, const Variable *v)
{
    const int shown = v->what == OUTPUT ? STATE_OF_OUTPUT[v->place - AT_OUTPUTS] : -1;
    if (!c->exchange || !(c->now.phase & (EVENT | CONTINUOUS)))
        return NULL;
    if (v->what == STATE)
        return c->now.memory + v->place;
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
        if (v->what == PARAMETER && c->now.started)
            return refuse(c, "parameter %s cannot be set any more; set it before initialization ends",
                          v->name);
        if (!isfinite(values[k])) /* a host that tries states can try another one */
            return (settable_state(c, v) ? refuse : fail)(c, "%s was set to %g, not a number",
                                                          v->name, values[k]);
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *v = &VARIABLES[references[k]];
        double *state = settable_state(c, v);
        *(state ? state : c->now.memory + v->place) = values[k];
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
                           c->now.memory[AT_TOLERANCE], &c->work, INFO(c), MAX_STEPS);
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
    double update[AT_LEAST_1(DISCRETE)] = {0.0};
    EQUATIONS(c)->sample(EQUATIONS(c), t, STATES(c), HELD(c), PARAMETERS(c), update);
    memcpy(HELD(c) + INPUTS, update, DISCRETE * sizeof *update);
    c->now.memory[AT_SAMPLES] += 1.0;
}

/* Update the discrete states at every sample instant in [t0, c->end). */
static Status advance_sampled(Instance *c, double t0)
{
    const double period = c->now.memory[AT_SAMPLE_TIME < 0 ? 0 : AT_SAMPLE_TIME];
    double now = t0;
    double *samples = &c->now.memory[AT_SAMPLES];
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
    if (c->now.failure[0])
        say(c, ERROR, c->now.failure);
    return c->now.failure[0] != 0;
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
        c->now.memory[STEP_START < 0 ? 0 : STEP_START] = t;
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

/* -- model exchange ----------------------------------------------------------------------- */

typedef struct {
    int states_changed;
    int next_time_defined;
    double next_time;
} Events;

/* Carry out what is due: samples, and events of the present mode. */
static Status update_discrete_states(Instance *c, Events *events)
{
    double *memory = c->now.memory;
    memset(events, 0, sizeof *events);
    if (stopped(c))
        return ERROR;
    if (AT_SAMPLE_TIME >= 0) {
        const double period = memory[AT_SAMPLE_TIME < 0 ? 0 : AT_SAMPLE_TIME];
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
    if (n != N || (n && !values))
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
    const Variable *v = &VARIABLES[reference < REFERENCES ? reference : 0];
    return v->what == DERIVATIVE ? v->place : v->what == OUTPUT ? v->place - AT_OUTPUTS + N : -1;
}

/* Column of a known, which is a state or an input; -1 if it has none. */
static int column_of(uint32_t reference)
{
    const Variable *v = &VARIABLES[reference < REFERENCES ? reference : 0];
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
    double by_row[N + OUTPUT_COUNT + 1] = {0.0};
    double by_column[N + INPUTS + 1] = {0.0};
    double values[AT_LEAST_1(PARTIALS)] = {0.0};
    if ((n && !unknowns) || (m && !knowns) || ((adjoint ? n : m) && !seed) ||
        ((adjoint ? m : n) && !sensitivity))
        return refuse(c, "a null pointer was given for partial derivatives");
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
    partial(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), values);
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

/* -- saved states ------------------------------------------------------------------------- */

typedef struct {
    char mark[8];
    uint64_t model; /* identifies the FMU and the kind of simulation */
    uint64_t check; /* hash of the bytes that follow */
    uint64_t size;
} Header;

static const char MARK[8] = {'b', 's', 's', 't', 'a', 't', 'e', '1'};

/* FNV-1a */
static uint64_t hash(const void *data, size_t n)
{
    const unsigned char *bytes = data;
    uint64_t value = 14695981039346656037u;
    for (size_t k = 0; k < n; k++)
        value = (value ^ bytes[k]) * 1099511628211u;
    return value;
}

static uint64_t model_hash(const Instance *c)
{
    return hash(TOKEN, sizeof TOKEN) + (uint64_t)c->exchange;
}

static Kept *find_kept(Instance *c, const void *state)
{
    for (Kept *k = c->kept; k; k = k->next) {
        if (k == state)
            return k;
    }
    refuse(c, state ? "this is no saved state of this instance" : "a null pointer was given for a "
                                                                   "saved state");
    return NULL;
}

static Kept *keep(Instance *c)
{
    Kept *k = calloc(1, sizeof *k);
    if (!k) {
        refuse(c, "there is no memory for a saved state");
        return NULL;
    }
    k->next = c->kept;
    c->kept = k;
    return k;
}

static Status save_state(Instance *c, void **state)
{
    Kept *k;
    if (!state)
        return refuse(c, "a null pointer was given for a saved state");
    k = *state ? find_kept(c, *state) : keep(c);
    if (!k)
        return ERROR;
    if (!take_history(&k->history, c->history, DELAYS > 0 ? c->history[ROOM] : 0.0))
        return refuse(c, "there is no memory for a saved state");
    k->saved = c->now;
    *state = k;
    return OK;
}

static Status restore_state(Instance *c, const void *state)
{
    const Kept *k = find_kept(c, state);
    if (!k)
        return ERROR;
    if (!remember(c, k->history, DELAYS > 0 ? k->history[ROOM] : 0.0))
        return refuse(c, "there is no memory for what delayed signals were");
    c->now = k->saved;
    scale_tolerances(c);
    c->stale = 1;
    return OK;
}

static Status forget_state(Instance *c, void **state)
{
    Kept *found;
    if (!state)
        return refuse(c, "a null pointer was given for a saved state");
    if (!*state)
        return OK;
    found = find_kept(c, *state);
    if (!found)
        return ERROR;
    for (Kept **link = &c->kept; *link; link = &(*link)->next) {
        if (*link == found) {
            *link = found->next;
            break;
        }
    }
    free(found->history);
    free(found);
    *state = NULL;
    return OK;
}

static Status serialized_size(Instance *c, const void *state, size_t *size)
{
    const Kept *k = find_kept(c, state);
    if (!k)
        return ERROR;
    if (!size)
        return refuse(c, "a null pointer was given for a size");
    *size = sizeof(Header) + sizeof k->saved + bytes_of(k->history);
    return OK;
}

static Status serialize_state(Instance *c, const void *state, void *bytes, size_t size)
{
    const Kept *k = find_kept(c, state);
    Header header;
    char *body;
    if (!k)
        return ERROR;
    header.size = sizeof k->saved + bytes_of(k->history);
    if (!bytes || size < sizeof header + header.size)
        return refuse(c, "%lu bytes were given for a state%s, expected %lu", (unsigned long)size,
                      bytes ? "" : " by a null pointer",
                      (unsigned long)(sizeof header + header.size));
    memcpy(header.mark, MARK, sizeof header.mark);
    header.model = model_hash(c);
    body = (char *)bytes + sizeof header;
    memcpy(body, &k->saved, sizeof k->saved);
    if (DELAYS > 0)
        memcpy(body + sizeof k->saved, k->history, bytes_of(k->history));
    header.check = hash(body, header.size);
    memcpy(bytes, &header, sizeof header);
    return OK;
}

static Status deserialize_state(Instance *c, const void *bytes, size_t size, void **state)
{
    Header header;
    const char *body;
    Kept *k;
    const size_t least = sizeof k->saved + (DELAYS > 0 ? HISTORY_BYTES(0) : 0);
    double room = 0.0;
    if (!bytes || !state)
        return refuse(c, "a null pointer was given for a serialized state");
    body = (const char *)bytes + sizeof header;
    if (size < sizeof header + least)
        return refuse(c, "%lu bytes are no serialized state of this FMU, which has %lu",
                      (unsigned long)size, (unsigned long)(sizeof header + least));
    memcpy(&header, bytes, sizeof header);
    if (memcmp(header.mark, MARK, sizeof header.mark) || header.model != model_hash(c) ||
        header.size < least || header.size > size - sizeof header ||
        header.check != hash(body, header.size))
        return refuse(c, "these bytes are no serialized state of this FMU, or are damaged");
    k = *state ? find_kept(c, *state) : keep(c);
    if (!k)
        return ERROR;
    if (DELAYS > 0)
        memcpy(&room, body + sizeof k->saved + ROOM * sizeof room, sizeof room);
    if (!take_history(&k->history, NULL, room))
        return refuse(c, "there is no memory for a saved state");
    memcpy(&k->saved, body, sizeof k->saved);
    if (DELAYS > 0)
        memcpy(k->history, body + sizeof k->saved, bytes_of(k->history));
    *state = k;
    return OK;
}

#endif
