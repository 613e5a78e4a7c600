/* FMI 2.0, co-simulation and model exchange: the names and rules of that version around one
 * component. This is the one file to compile; it includes all others. */
#include "model.h"

#include "system.h"
#include "equations.h"
#include "component.h"
#include "fmi2_declarations.h"

#ifdef FMI2_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI2_FUNCTION_PREFIX
#endif
#include "exported.h"

typedef void (*Logger)(void *, fmi2String, fmi2Status, fmi2String, fmi2String, ...);

static void log_to(Logger logger, void *environment, const char *name, Status status,
                   const char *category, const char *text)
{
    /* the text is a format, and hosts may or may not read it as one: leave no sign of that */
    char plain[LONGEST_TEXT];
    size_t n = 0;
    for (; text[n] && n + 1 < sizeof plain; n++)
        plain[n] = text[n] == '%' ? ' ' : text[n];
    plain[n] = '\0';
    logger(environment, name, status, category, plain);
}

static void log_message(const Instance *c, Status status, const char *category, const char *text)
{
    log_to((Logger)c->logger, c->environment, c->name, status, category, text);
}

/* -- life cycle --------------------------------------------------------------------------- */

EXPORT(const char *) NAMED(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORT(const char *) NAMED(fmi2GetVersion)(void) { return "2.0"; }

EXPORT(fmi2Component)
NAMED(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                       const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                       fmi2Boolean logging)
{
    const char *wrong = NULL;
    Instance *c;
    (void)resources;
    (void)visible;
    (void)logging; /* there are only errors to tell */
    if (!name || !name[0])
        wrong = "an instance needs a name";
    else if (!token || strcmp(token, TOKEN))
        wrong = "the guid is not that of " MODEL ", version " TOKEN
                "; the model description belongs to another FMU";
    else if (type != 1 && !(type == 0 && CAN_EXCHANGE))
        wrong = MODEL " is not made for this kind of simulation";
    if (wrong) {
        if (functions && functions->logger)
            log_to(functions->logger, functions->componentEnvironment, name ? name : "", ERROR,
                   "logStatusError", wrong);
        return NULL;
    }
    c = make_instance(name, type == 0);
    if (c && functions && functions->logger) {
        c->logger = (void (*)(void))functions->logger;
        c->environment = functions->componentEnvironment;
        c->log = log_message;
    }
    return c;
}

EXPORT(void) NAMED(fmi2FreeInstance)(fmi2Component instance) { free_instance(instance); }

EXPORT(fmi2Status)
NAMED(fmi2SetDebugLogging)(fmi2Component instance, fmi2Boolean on, size_t n,
                           const fmi2String categories[])
{
    CHECK(ANY, "fmi2SetDebugLogging");
    (void)on;
    (void)n;
    (void)categories;
    return OK;
}

EXPORT(fmi2Status)
NAMED(fmi2SetupExperiment)(fmi2Component instance, fmi2Boolean has_tolerance, fmi2Real tolerance,
                           fmi2Real start, fmi2Boolean has_stop, fmi2Real stop)
{
    CHECK(INSTANTIATED, "fmi2SetupExperiment");
    (void)has_stop;
    (void)stop;
    return begin(c, has_tolerance, tolerance, start);
}

EXPORT(fmi2Status) NAMED(fmi2EnterInitializationMode)(fmi2Component instance)
{
    CHECK(INSTANTIATED, "fmi2EnterInitializationMode");
    c->now.phase = INITIALIZING;
    return OK;
}

EXPORT(fmi2Status) NAMED(fmi2ExitInitializationMode)(fmi2Component instance)
{
    CHECK(INITIALIZING, "fmi2ExitInitializationMode");
    return end_initialization(c);
}

EXPORT(fmi2Status) NAMED(fmi2Terminate)(fmi2Component instance)
{
    CHECK(RUNNING, "fmi2Terminate");
    c->now.phase = TERMINATED;
    return OK;
}

EXPORT(fmi2Status) NAMED(fmi2Reset)(fmi2Component instance)
{
    CHECK(ANY, "fmi2Reset");
    back_to_start(c);
    return OK;
}

/* -- variables ---------------------------------------------------------------------------- */

EXPORT(fmi2Status)
NAMED(fmi2GetReal)(fmi2Component instance, const fmi2ValueReference references[], size_t n,
                   fmi2Real values[])
{
    CHECK(ANY, "fmi2GetReal");
    return get_numbers(c, references, n, values);
}

EXPORT(fmi2Status)
NAMED(fmi2SetReal)(fmi2Component instance, const fmi2ValueReference references[], size_t n,
                   const fmi2Real values[])
{
    CHECK(ALIVE, "fmi2SetReal");
    return set_numbers(c, references, n, values);
}

EXPORT(fmi2Status)
NAMED(fmi2GetString)(fmi2Component instance, const fmi2ValueReference references[], size_t n,
                     fmi2String values[])
{
    CHECK(ANY, "fmi2GetString");
    if (n && (!references || !values))
        return refuse(c, "a null pointer was given for %lu values", (unsigned long)n);
    for (size_t k = 0; k < n; k++) {
        if (references[k] != MESSAGE_REFERENCE)
            return refuse(c, "no String has the value reference %u", references[k]);
        values[k] = c->now.failure;
    }
    return OK;
}

/* Numbers that are not Real, and Strings that could be set: there are none. */
#define NONE_OF(call, constant, type, what)                                                        \
    EXPORT(fmi2Status)                                                                             \
    NAMED(call)(fmi2Component instance, const fmi2ValueReference references[], size_t n,           \
                constant type values[])                                                            \
    {                                                                                              \
        CHECK(ANY, #call);                                                                         \
        (void)references;                                                                          \
        (void)values;                                                                              \
        return n ? refuse(c, "%lu %s were named, there are none", (unsigned long)n, what) : OK;    \
    }
NONE_OF(fmi2GetInteger, , fmi2Integer, "Integers")
NONE_OF(fmi2GetBoolean, , fmi2Boolean, "Booleans")
NONE_OF(fmi2SetInteger, const, fmi2Integer, "Integers")
NONE_OF(fmi2SetBoolean, const, fmi2Boolean, "Booleans")
NONE_OF(fmi2SetString, const, fmi2String, "Strings that can be set")

/* -- state -------------------------------------------------------------------------------- */

EXPORT(fmi2Status) NAMED(fmi2GetFMUstate)(fmi2Component instance, fmi2FMUstate *state)
{
    CHECK(ANY, "fmi2GetFMUstate");
    return save_state(c, state);
}

EXPORT(fmi2Status) NAMED(fmi2SetFMUstate)(fmi2Component instance, fmi2FMUstate state)
{
    CHECK(ANY, "fmi2SetFMUstate");
    return restore_state(c, state);
}

EXPORT(fmi2Status) NAMED(fmi2FreeFMUstate)(fmi2Component instance, fmi2FMUstate *state)
{
    CHECK(ANY, "fmi2FreeFMUstate");
    return forget_state(c, state);
}

EXPORT(fmi2Status)
NAMED(fmi2SerializedFMUstateSize)(fmi2Component instance, fmi2FMUstate state, size_t *size)
{
    CHECK(ANY, "fmi2SerializedFMUstateSize");
    return serialized_size(c, state, size);
}

EXPORT(fmi2Status)
NAMED(fmi2SerializeFMUstate)(fmi2Component instance, fmi2FMUstate state, fmi2Byte bytes[],
                             size_t size)
{
    CHECK(ANY, "fmi2SerializeFMUstate");
    return serialize_state(c, state, bytes, size);
}

EXPORT(fmi2Status)
NAMED(fmi2DeSerializeFMUstate)(fmi2Component instance, const fmi2Byte bytes[], size_t size,
                               fmi2FMUstate *state)
{
    CHECK(ANY, "fmi2DeSerializeFMUstate");
    return deserialize_state(c, bytes, size, state);
}

EXPORT(fmi2Status)
NAMED(fmi2GetDirectionalDerivative)(fmi2Component instance, const fmi2ValueReference unknowns[],
                                    size_t n, const fmi2ValueReference knowns[], size_t m,
                                    const fmi2Real seed[], fmi2Real sensitivity[])
{
    CHECK(INITIALIZING | RUNNING, "fmi2GetDirectionalDerivative");
    return derivative_product(c, 0, unknowns, n, knowns, m, seed, sensitivity);
}

/* -- model exchange ----------------------------------------------------------------------- */

EXPORT(fmi2Status) NAMED(fmi2EnterEventMode)(fmi2Component instance)
{
    CHECK_KIND(EVENT | CONTINUOUS, "fmi2EnterEventMode", 1);
    c->now.phase = EVENT;
    return OK;
}

EXPORT(fmi2Status) NAMED(fmi2NewDiscreteStates)(fmi2Component instance, fmi2EventInfo *info)
{
    Events events;
    CHECK_KIND(EVENT, "fmi2NewDiscreteStates", 1);
    if (!info)
        return refuse(c, "a null pointer was given for the event info");
    memset(info, 0, sizeof *info);
    if (update_discrete_states(c, &events) != OK)
        return ERROR;
    info->valuesOfContinuousStatesChanged = events.states_changed;
    info->nextEventTimeDefined = events.next_time_defined;
    info->nextEventTime = events.next_time;
    return OK;
}

EXPORT(fmi2Status) NAMED(fmi2EnterContinuousTimeMode)(fmi2Component instance)
{
    CHECK_KIND(EVENT, "fmi2EnterContinuousTimeMode", 1);
    c->now.phase = CONTINUOUS;
    return OK;
}

EXPORT(fmi2Status)
NAMED(fmi2CompletedIntegratorStep)(fmi2Component instance, fmi2Boolean no_way_back,
                                   fmi2Boolean *enter_event_mode, fmi2Boolean *terminate)
{
    CHECK_KIND(CONTINUOUS, "fmi2CompletedIntegratorStep", 1);
    (void)no_way_back;
    if (!enter_event_mode || !terminate)
        return refuse(c, "a null pointer was given for what follows a step");
    *enter_event_mode = complete_step(c);
    *terminate = 0;
    return OK;
}

EXPORT(fmi2Status) NAMED(fmi2SetTime)(fmi2Component instance, fmi2Real time)
{
    CHECK_KIND(EVENT | CONTINUOUS, "fmi2SetTime", 1);
    if (!isfinite(time))
        return refuse(c, "the time was set to %g, not a number", time);
    set_time(c, time);
    return OK;
}

EXPORT(fmi2Status)
NAMED(fmi2SetContinuousStates)(fmi2Component instance, const fmi2Real values[], size_t n)
{
    CHECK_KIND(EVENT | CONTINUOUS, "fmi2SetContinuousStates", 1);
    return set_states(c, values, n);
}

EXPORT(fmi2Status) NAMED(fmi2GetDerivatives)(fmi2Component instance, fmi2Real values[], size_t n)
{
    CHECK_KIND(EVENT | CONTINUOUS | TERMINATED, "fmi2GetDerivatives", 1);
    return get_derivatives(c, values, n);
}

EXPORT(fmi2Status)
NAMED(fmi2GetEventIndicators)(fmi2Component instance, fmi2Real values[], size_t n)
{
    CHECK_KIND(INITIALIZING | EVENT | CONTINUOUS | TERMINATED, "fmi2GetEventIndicators", 1);
    return get_indicators(c, values, n);
}

EXPORT(fmi2Status)
NAMED(fmi2GetContinuousStates)(fmi2Component instance, fmi2Real values[], size_t n)
{
    CHECK_KIND(INITIALIZING | EVENT | CONTINUOUS | TERMINATED, "fmi2GetContinuousStates", 1);
    return get_states(c, values, n);
}

EXPORT(fmi2Status)
NAMED(fmi2GetNominalsOfContinuousStates)(fmi2Component instance, fmi2Real values[], size_t n)
{
    CHECK_KIND(ANY, "fmi2GetNominalsOfContinuousStates", 1);
    return get_array(c, NOMINAL, N, values, n, "nominal values");
}

/* -- co-simulation ------------------------------------------------------------------------ */

EXPORT(fmi2Status)
NAMED(fmi2DoStep)(fmi2Component instance, fmi2Real time, fmi2Real step, fmi2Boolean no_way_back)
{
    CHECK_KIND(STEPPING, "fmi2DoStep", 0);
    (void)no_way_back;
    return take_step(c, time, step);
}

EXPORT(fmi2Status) NAMED(fmi2CancelStep)(fmi2Component instance)
{
    CHECK_KIND(ANY, "fmi2CancelStep", 0);
    return refuse(c, "there is no step to cancel; every step is over when fmi2DoStep returns");
}

EXPORT(fmi2Status)
NAMED(fmi2SetRealInputDerivatives)(fmi2Component instance, const fmi2ValueReference references[],
                                   size_t n, const fmi2Integer orders[], const fmi2Real values[])
{
    CHECK_KIND(ANY, "fmi2SetRealInputDerivatives", 0);
    (void)references;
    (void)orders;
    (void)values;
    return n ? refuse(c, "inputs are held in a step; their derivatives cannot be set") : OK;
}

EXPORT(fmi2Status)
NAMED(fmi2GetRealOutputDerivatives)(fmi2Component instance, const fmi2ValueReference references[],
                                    size_t n, const fmi2Integer orders[], fmi2Real values[])
{
    CHECK_KIND(ANY, "fmi2GetRealOutputDerivatives", 0);
    (void)references;
    (void)orders;
    (void)values;
    return n ? refuse(c, "derivatives of outputs by time are not given") : OK;
}

EXPORT(fmi2Status)
NAMED(fmi2GetRealStatus)(fmi2Component instance, fmi2StatusKind kind, fmi2Real *value)
{
    CHECK_KIND(ANY, "fmi2GetRealStatus", 0);
    if (!value || kind != 2)
        return refuse(c, "of status, only the last successful time is a Real");
    *value = TIME(c);
    return OK;
}

EXPORT(fmi2Status)
NAMED(fmi2GetBooleanStatus)(fmi2Component instance, fmi2StatusKind kind, fmi2Boolean *value)
{
    CHECK_KIND(ANY, "fmi2GetBooleanStatus", 0);
    if (!value || kind != 3)
        return refuse(c, "of status, only whether the instance terminated is a Boolean");
    *value = 0;
    return OK;
}

#define NO_STATUS(call, type)                                                                      \
    EXPORT(fmi2Status) NAMED(call)(fmi2Component instance, fmi2StatusKind kind, type *value)       \
    {                                                                                              \
        CHECK_KIND(ANY, #call, 0);                                                                 \
        (void)kind;                                                                                \
        (void)value;                                                                               \
        return refuse(c, "no step is ever pending, so there is no such status");                   \
    }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)
