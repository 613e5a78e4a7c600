/* One instance of a component, for any version of FMI: its memory and its messages.
 *
 * There are no globals. All numbers of an instance are in one array, as in the FMU that pythonfmu
 * makes of the same component; VARIABLES has the place of the number of each value reference. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "tables.h"

#include "stepper.c"

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

/* Everything that determines how an instance continues. Its numbers and its watches follow it. */
typedef struct {
    int32_t phase;
    int32_t started; /* initialization is over */
    char failure[LONGEST_TEXT]; /* why it cannot continue; empty without a failure */
} Saved;
#define SAVED_DOUBLES ((sizeof(Saved) + EVENTS * sizeof(Watch)) / sizeof(double) + MEMORY)
#define SENSITIVITIES (size_t)(N + OUTPUT_COUNT + N + INPUTS) /* by row, and by column */
#define SAVED_BYTES (SAVED_DOUBLES * sizeof(double))

typedef struct Kept {
    struct Kept *next;
    Saved *saved;    /* follows it in memory */
    double *history; /* null without delays */
} Kept;

typedef struct Instance {
    Saved *now;
    double *memory; /* all its numbers */
    Watch *watch;   /* model exchange */
    int exchange; /* for model exchange, not co-simulation */
    int stale;    /* outputs do not belong to the present state and inputs */
    int derived;  /* derivatives belong to the present outputs */
    double *derivatives, *atol, *signals, *scratch;
    System system; /* the equations; with delays they read the history */
    Delays delays;
    double *history; /* null without delays */
    Work work;
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

static void complain(Instance *c, int stops, const char *format, va_list values)
{
    char text[LONGEST_TEXT] = "";
    const int used = snprintf(text, LONGEST_TEXT, "%.200s: ", c->name);
    vsnprintf(text + used, (size_t)(LONGEST_TEXT - used), format, values);
    if (stops && !c->now->failure[0])
        memcpy(c->now->failure, text, sizeof text);
    say(c, ERROR, text);
}

#define COMPLAIN(stops)                                                                            \
    va_list values;                                                                                \
    va_start(values, format);                                                                      \
    complain(c, stops, format, values);                                                            \
    va_end(values);                                                                                \
    return ERROR

/* Refuse an invalid call; the instance is not changed. */
static Status refuse(Instance *c, const char *format, ...) { COMPLAIN(0); }

/* Stop the instance until it is reset or set to a saved state; the first reason is kept. */
static Status fail(Instance *c, const char *format, ...) { COMPLAIN(1); }

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
    if (c->now->phase & phases)
        return 1;
    refuse(c, "%s was called %s, where it is not allowed", call, phase_name(c->now->phase));
    return 0;
}

/* -- delayed signals ---------------------------------------------------------------------- */

#define EQUATIONS(c) ((const System *)&(c)->system)
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

#define HELD(c) ((c)->memory)
#define PARAMETERS(c) ((c)->memory + AT_PARAMETERS)
#define STATES(c) ((c)->memory + AT_STATES)
#define OUTPUTS(c) ((c)->memory + AT_OUTPUTS)
#define INFO(c) ((Info *)((c)->memory + AT_INFO))
#define TIME(c) ((c)->memory[AT_TIME])

static void set_time(Instance *c, double t)
{
    TIME(c) = t;
    /* model exchange has no communication steps: a feedback law's step always begins now */
    if (c->exchange && STEP_START >= 0)
        c->memory[STEP_START] = t;
    c->stale = 1;
}

static void scale_tolerances(Instance *c)
{
    for (int i = 0; i < N; i++)
        c->atol[i] = NOMINAL[i] * c->memory[AT_TOLERANCE];
}

/* Set tangents from their inputs, if a new frame is requested. */
static void take_frame(Instance *c)
{
    double *memory = c->memory;
    if (FRAME_COUNT > 0 && memory[FRAME_ASK] != memory[FRAME_SEEN]) {
        memory[FRAME_SEEN] = memory[FRAME_ASK];
        memcpy(memory + FRAME_TO, memory + FRAME_FROM, FRAME_COUNT * sizeof *memory);
    }
}

#endif
