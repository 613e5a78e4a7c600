/* Functions for hosts that are equal in FMI 2.0 and 3.0. Included once, by fmi2.c or fmi3.c, after
 * FMI(name): a name of that version. Compiled into another program, names of functions get the
 * prefix FUNCTION_PREFIX. */
#ifndef CALLS_H
#define CALLS_H

#include "exchange.h"
#include "saved_states.h"

#if defined __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter" /* not all arguments of hosts are used here */
#endif

/* EXPORT(type) name: a function that hosts find. */
#if defined _WIN32 || defined __CYGWIN__
#define EXPORT(type) __declspec(dllexport) type
#elif defined __GNUC__
#define EXPORT(type) __attribute__((visibility("default"))) type
#else
#define EXPORT(type) type
#endif

#ifdef FUNCTION_PREFIX
#define JOINED_(a, b) a##b
#define JOINED(a, b) JOINED_(a, b)
#define NAMED(name) JOINED(FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif
#define TEXT_(name) #name
#define TEXT(name) TEXT_(name)

/* Refuse a call without an instance, or with an instance in another phase. */
#define CHECK(phases, call)                                                                        \
    Instance *c = instance;                                                                        \
    if (!c || !allowed(c, phases, call))                                                           \
        return ERROR
#define CHECK_KIND(phases, call, kind)                                                             \
    Instance *c = instance;                                                                        \
    if (c && c->exchange != (kind))                                                                \
        return refuse(c, "%s belongs to %s", call, (kind) ? "model exchange" : "co-simulation");   \
    if (!c || !allowed(c, phases, call))                                                           \
        return ERROR

/* A function that is allowed in some phases, with its arguments and its result. */
#define CALL(name, phases, arguments, result)                                                      \
    EXPORT(FMI(Status)) NAMED(FMI(name)) arguments                                                 \
    {                                                                                              \
        CHECK(phases, TEXT(FMI(name)));                                                            \
        return result;                                                                             \
    }
/* The same, for one kind of simulation. */
#define CALL_OF_KIND(name, kind, phases, arguments, result)                                        \
    EXPORT(FMI(Status)) NAMED(FMI(name)) arguments                                                 \
    {                                                                                              \
        CHECK_KIND(phases, TEXT(FMI(name)), kind);                                                 \
        return result;                                                                             \
    }
#define EXCHANGE(name, phases, arguments, result) CALL_OF_KIND(name, 1, phases, arguments, result)
#define SIMULATION(name, phases, arguments, result) CALL_OF_KIND(name, 0, phases, arguments, result)

/* Arguments of calls by hosts. */
#define ALONE (void *instance)
#define REFERENCED void *instance, const uint32_t references[], size_t n
#define DERIVED                                                                                    \
    void *instance, const uint32_t unknowns[], size_t n, const uint32_t knowns[], size_t m,        \
        const double seed[]

CALL(SetDebugLogging, ANY,
     (void *instance, FMI(Boolean) on, size_t n, const char *const categories[]), OK)
CALL(ExitInitializationMode, INITIALIZING, ALONE, end_initialization(c))
CALL(Terminate, RUNNING, ALONE, enter(c, TERMINATED))
CALL(Reset, ANY, ALONE, back_to_start(c))

/* Functions of saved states; their names differ between the versions. */
#define STATE_CALLS(get, set, drop, measure, write, read)                                          \
    CALL(get, ANY, (void *instance, void **state), save_state(c, state))                           \
    CALL(set, ANY, (void *instance, void *state), restore_state(c, state))                         \
    CALL(drop, ANY, (void *instance, void **state), forget_state(c, state))                        \
    CALL(measure, ANY, (void *instance, void *state, size_t *size),                                \
         serialized_size(c, state, size))                                                          \
    CALL(write, ANY, (void *instance, void *state, FMI(Byte) bytes[], size_t size),                \
         serialize_state(c, state, bytes, size))                                                   \
    CALL(read, ANY, (void *instance, const FMI(Byte) bytes[], size_t size, void **state),          \
         deserialize_state(c, bytes, size, state))

/* -- model exchange ----------------------------------------------------------------------- */

#define SEEN (INITIALIZING | EVENT | CONTINUOUS | TERMINATED)
#define VALUES (void *instance, double values[], size_t n)

EXCHANGE(EnterEventMode, EVENT | CONTINUOUS, ALONE, enter(c, EVENT))
EXCHANGE(EnterContinuousTimeMode, EVENT, ALONE, enter(c, CONTINUOUS))
EXCHANGE(SetTime, EVENT | CONTINUOUS, (void *instance, double time), go_to(c, time))
EXCHANGE(SetContinuousStates, EVENT | CONTINUOUS,
         (void *instance, const double values[], size_t n), set_states(c, values, n))
EXCHANGE(GetEventIndicators, SEEN, VALUES, get_indicators(c, values, n))
EXCHANGE(GetContinuousStates, SEEN, VALUES, get_states(c, values, n))
EXCHANGE(GetNominalsOfContinuousStates, ANY, VALUES,
         get_array(c, NOMINAL, N, values, n, "nominal values"))

EXPORT(FMI(Status))
NAMED(FMI(CompletedIntegratorStep))(void *instance, FMI(Boolean) no_way_back,
                                    FMI(Boolean) *enter_event_mode, FMI(Boolean) *terminate)
{
    CHECK_KIND(CONTINUOUS, TEXT(FMI(CompletedIntegratorStep)), 1);
    if (!enter_event_mode || !terminate)
        return refuse(c, "a null pointer was given for what follows a step");
    *enter_event_mode = complete_step(c) != 0;
    *terminate = 0;
    return OK;
}

#endif
