/* FMI 2.0, co-simulation and model exchange: the names and rules of that version around one
 * component. This is the one file to compile; it includes all others. */
#include "component.h"
#include "fmi2_declarations.h"

#ifdef FMI2_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI2_FUNCTION_PREFIX
#endif
#define FMI(name) fmi2##name
#include "calls.h"

typedef void (*Logger)(void *, fmi2String, fmi2Status, fmi2String, fmi2String, ...);

static void log_to(Logger logger, void *environment, const char *name, Status status,
                   const char *category, const char *text)
{
    /* hosts may or may not use the text as a format string, so it must not contain % */
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
                       fmi2Boolean logging) /* not used: only errors are logged */
{
    const char *wrong = NULL;
    Instance *c;
    if (!name || !name[0])
        wrong = "an instance needs a name";
    else if (!token || strcmp(token, TOKEN))
        wrong = "the guid is not that of %s, version %s; the model description belongs to another "
                "FMU";
    else if (type != 1 && !(type == 0 && CAN_EXCHANGE))
        wrong = "%s is not made for this kind of simulation";
    if (wrong) {
        char text[LONGEST_TEXT];
        snprintf(text, sizeof text, wrong, MODEL, TOKEN);
        if (functions && functions->logger)
            log_to(functions->logger, functions->componentEnvironment, name ? name : "", ERROR,
                   "logStatusError", text);
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

CALL(SetupExperiment, INSTANTIATED,
     (void *instance, fmi2Boolean has_tolerance, double tolerance, double start,
      fmi2Boolean has_stop, double stop),
     begin(c, has_tolerance, tolerance, start))
CALL(EnterInitializationMode, INSTANTIATED, ALONE, enter(c, INITIALIZING))

/* -- variables ---------------------------------------------------------------------------- */

CALL(GetReal, ANY, (REFERENCED, double values[]), get_numbers(c, references, n, values))
CALL(SetReal, ALIVE, (REFERENCED, const double values[]), set_numbers(c, references, n, values))
CALL(GetString, ANY, (REFERENCED, const char *values[]), get_failure(c, references, n, values))

/* There are no numbers of other types than Real, and no Strings that can be set. */
#define NONE_OF(name, constant, type, what)                                                        \
    CALL(name, ANY, (REFERENCED, constant type values[]),                                          \
         n ? refuse(c, "%lu %s were given, but there are none", (unsigned long)n, what) : OK)
NONE_OF(GetInteger, , fmi2Integer, "Integers")
NONE_OF(GetBoolean, , fmi2Boolean, "Booleans")
NONE_OF(SetInteger, const, fmi2Integer, "Integers")
NONE_OF(SetBoolean, const, fmi2Boolean, "Booleans")
NONE_OF(SetString, const, fmi2String, "Strings that can be set")

STATE_CALLS(GetFMUstate, SetFMUstate, FreeFMUstate, SerializedFMUstateSize, SerializeFMUstate,
            DeSerializeFMUstate)
CALL(GetDirectionalDerivative, INITIALIZING | RUNNING, (DERIVED, double sensitivity[]),
     derivative_product(c, 0, unknowns, n, knowns, m, seed, sensitivity))

/* -- model exchange ----------------------------------------------------------------------- */

EXCHANGE(GetDerivatives, EVENT | CONTINUOUS | TERMINATED, VALUES, get_derivatives(c, values, n))

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

/* -- co-simulation ------------------------------------------------------------------------ */

SIMULATION(DoStep, STEPPING,
           (void *instance, double time, double step, fmi2Boolean no_way_back),
           take_step(c, time, step))
SIMULATION(CancelStep, ANY, ALONE,
           refuse(c, "there is no step to cancel; every step is over when fmi2DoStep returns"))
SIMULATION(SetRealInputDerivatives, ANY,
           (REFERENCED, const fmi2Integer orders[], const double values[]),
           n ? refuse(c, "inputs are held in a step; their derivatives cannot be set") : OK)
SIMULATION(GetRealOutputDerivatives, ANY, (REFERENCED, const fmi2Integer orders[], double values[]),
           n ? refuse(c, "derivatives of outputs by time are not given") : OK)

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

#define NO_STATUS(name, type)                                                                      \
    SIMULATION(name, ANY, (void *instance, fmi2StatusKind kind, type *value),                      \
               refuse(c, "no step is ever pending, so there is no such status"))
NO_STATUS(GetStatus, fmi2Status)
NO_STATUS(GetIntegerStatus, fmi2Integer)
NO_STATUS(GetStringStatus, fmi2String)
