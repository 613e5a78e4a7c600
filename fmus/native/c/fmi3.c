/* FMI 3.0, co-simulation and model exchange: the names and rules of that version around one
 * component. This is the one file to compile; it includes all others. */
#include "component.h"
#include "fmi3_declarations.h"

#ifdef FMI3_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI3_FUNCTION_PREFIX
#endif
#define FMI(name) fmi3##name
#include "calls.h"

static void log_message(const Instance *c, Status status, const char *category, const char *text)
{
    ((fmi3LogMessageCallback)c->logger)(c->environment, status, category, text);
}

static Status give(Instance *c, size_t *n, size_t number)
{
    if (!n)
        return refuse(c, "a null pointer was given for a number");
    *n = number;
    return OK;
}

static int fits(Instance *c, size_t given, size_t needed)
{
    if (given != needed)
        refuse(c, "there is room for %lu values, %lu are needed", (unsigned long)given,
               (unsigned long)needed);
    return given == needed;
}

/* -- life cycle --------------------------------------------------------------------------- */

EXPORT(const char *) NAMED(fmi3GetVersion)(void) { return "3.0"; }

static Instance *instantiate(fmi3String name, fmi3String token, int exchange, const char *wrong,
                             fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    Instance *c;
    if (!name || !name[0])
        wrong = "an instance needs a name";
    else if (!token || strcmp(token, TOKEN))
        wrong = "the instantiation token is not that of %s, version %s; the model description belongs "
                "to another FMU";
    if (wrong) {
        char text[LONGEST_TEXT];
        snprintf(text, sizeof text, wrong, MODEL, TOKEN);
        if (log)
            log(environment, ERROR, "logStatusError", text);
        return NULL;
    }
    c = make_instance(name, exchange);
    if (!c)
        return NULL;
    c->environment = environment;
    if (log) {
        c->logger = (void (*)(void))log;
        c->log = log_message;
    }
    return c;
}

EXPORT(fmi3Instance)
NAMED(fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                    fmi3Boolean visible, fmi3Boolean logging,
                                    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{ /* only errors are logged, so that `logging` is not used */
    return instantiate(name, token, 1, CAN_EXCHANGE ? NULL : "%s is not for model exchange",
                       environment, log);
}

EXPORT(fmi3Instance)
NAMED(fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources,
                                   fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
                                   fmi3Boolean early_return, const fmi3ValueReference required[],
                                   size_t required_count, fmi3InstanceEnvironment environment,
                                   fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    const char *wrong = NULL;
    if (event_mode)
        wrong = "%s has no event mode in co-simulation; its events happen within the steps";
    else if (required_count)
        wrong = "%s has no intermediate update";
    return instantiate(name, token, 0, wrong, environment, log);
}

EXPORT(fmi3Instance)
NAMED(fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                         fmi3LockPreemptionCallback lock,
                                         fmi3UnlockPreemptionCallback unlock)
{
    return instantiate(name, token, 0, "%s is not for scheduled execution", environment, log);
}

EXPORT(void) NAMED(fmi3FreeInstance)(fmi3Instance instance)
{
    Instance *c = instance;
    if (c && allowed(c, ANY, "fmi3FreeInstance"))
        free_instance(c);
}

CALL(EnterInitializationMode, INSTANTIATED,
     (void *instance, fmi3Boolean has_tolerance, double tolerance, double start,
      fmi3Boolean has_stop, double stop),
     begin(c, has_tolerance, tolerance, start) == OK ? enter(c, INITIALIZING) : ERROR)

/* -- variables ---------------------------------------------------------------------------- */

CALL(GetFloat64, ANY, (REFERENCED, double values[], size_t room),
     fits(c, room, n) ? get_numbers(c, references, n, values) : ERROR)
CALL(SetFloat64, ALIVE, (REFERENCED, const double values[], size_t room),
     fits(c, room, n) ? set_numbers(c, references, n, values) : ERROR)
CALL(GetString, ANY, (REFERENCED, const char *values[], size_t room),
     fits(c, room, n) ? get_failure(c, references, n, values) : ERROR)

/* There are no variables of other types. */
#define NONE_OF(name, constant, type)                                                              \
    CALL(name, ANY, (REFERENCED, constant type values[], size_t room),                             \
         n ? refuse(c, "%s was called for %lu values, there are none", TEXT(FMI(name)),            \
                    (unsigned long)n)                                                              \
           : OK)
#define NONE_EITHER_WAY(type)                                                                      \
    NONE_OF(Get##type, , fmi3##type)                                                               \
    NONE_OF(Set##type, const, fmi3##type)
NONE_EITHER_WAY(Float32)
NONE_EITHER_WAY(Int8)
NONE_EITHER_WAY(UInt8)
NONE_EITHER_WAY(Int16)
NONE_EITHER_WAY(UInt16)
NONE_EITHER_WAY(Int32)
NONE_EITHER_WAY(UInt32)
NONE_EITHER_WAY(Int64)
NONE_EITHER_WAY(UInt64)
NONE_EITHER_WAY(Boolean)
NONE_OF(SetString, const, fmi3String)

/* The same for functions with other arguments. */
#define REFUSED(name, arguments, what)                                                             \
    CALL(name, ANY, arguments,                                                                     \
         n ? refuse(c, "%s was called; there are no " what, TEXT(FMI(name))) : OK)
REFUSED(GetBinary, (REFERENCED, size_t s[], fmi3Binary v[], size_t m), "binary variables")
REFUSED(SetBinary, (REFERENCED, const size_t s[], const fmi3Binary v[], size_t m),
        "binary variables")
REFUSED(GetClock, (REFERENCED, fmi3Clock v[]), "clocks")
REFUSED(SetClock, (REFERENCED, const fmi3Clock v[]), "clocks")
REFUSED(GetIntervalDecimal, (REFERENCED, fmi3Float64 v[], fmi3IntervalQualifier q[]), "clocks")
REFUSED(GetIntervalFraction,
        (REFERENCED, fmi3UInt64 v[], fmi3UInt64 w[], fmi3IntervalQualifier q[]), "clocks")
REFUSED(GetShiftDecimal, (REFERENCED, fmi3Float64 v[]), "clocks")
REFUSED(GetShiftFraction, (REFERENCED, fmi3UInt64 v[], fmi3UInt64 w[]), "clocks")
REFUSED(SetIntervalDecimal, (REFERENCED, const fmi3Float64 v[]), "clocks")
REFUSED(SetIntervalFraction, (REFERENCED, const fmi3UInt64 v[], const fmi3UInt64 w[]), "clocks")
REFUSED(SetShiftDecimal, (REFERENCED, const fmi3Float64 v[]), "clocks")
REFUSED(SetShiftFraction, (REFERENCED, const fmi3UInt64 v[], const fmi3UInt64 w[]), "clocks")
REFUSED(GetOutputDerivatives, (REFERENCED, const fmi3Int32 o[], fmi3Float64 v[], size_t m),
        "derivatives of outputs by time")

#define NEVER(name, arguments, what)                                                               \
    CALL(name, ANY, arguments, refuse(c, "%s was called; there are no " what, TEXT(FMI(name))))
NEVER(EnterConfigurationMode, ALONE, "structural parameters")
NEVER(ExitConfigurationMode, ALONE, "structural parameters")
NEVER(ActivateModelPartition, (fmi3Instance instance, fmi3ValueReference r, fmi3Float64 t),
      "model partitions")
NEVER(GetNumberOfVariableDependencies,
      (fmi3Instance instance, fmi3ValueReference r, size_t *n), "dependencies of elements")
NEVER(GetVariableDependencies,
      (fmi3Instance instance, fmi3ValueReference r, size_t i[], fmi3ValueReference s[], size_t j[],
       fmi3DependencyKind k[], size_t n),
      "dependencies of elements")

STATE_CALLS(GetFMUState, SetFMUState, FreeFMUState, SerializedFMUStateSize, SerializeFMUState,
            DeserializeFMUState)

/* -- partial derivatives ------------------------------------------------------------------ */

CALL(GetDirectionalDerivative, INITIALIZING | RUNNING,
     (DERIVED, size_t seeds, double sensitivity[], size_t room),
     fits(c, seeds, m) && fits(c, room, n)
         ? derivative_product(c, 0, unknowns, n, knowns, m, seed, sensitivity)
         : ERROR)
CALL(GetAdjointDerivative, INITIALIZING | RUNNING,
     (DERIVED, size_t seeds, double sensitivity[], size_t room),
     fits(c, seeds, n) && fits(c, room, m)
         ? derivative_product(c, 1, unknowns, n, knowns, m, seed, sensitivity)
         : ERROR)

/* -- model exchange ----------------------------------------------------------------------- */

EXCHANGE(GetContinuousStateDerivatives, SEEN, VALUES, get_derivatives(c, values, n))
EXCHANGE(EvaluateDiscreteStates, INITIALIZING | EVENT, ALONE, OK)

EXPORT(fmi3Status)
NAMED(fmi3UpdateDiscreteStates)(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                fmi3Boolean *nominals_changed, fmi3Boolean *states_changed,
                                fmi3Boolean *next_time_defined, fmi3Float64 *next_time)
{
    Events events;
    CHECK_KIND(EVENT, "fmi3UpdateDiscreteStates", 1);
    if (!again || !terminate || !nominals_changed || !states_changed || !next_time_defined ||
        !next_time)
        return refuse(c, "a null pointer was given for what an event leads to");
    if (update_discrete_states(c, &events) != OK)
        return ERROR;
    *again = *terminate = *nominals_changed = false;
    *states_changed = events.states_changed != 0;
    *next_time_defined = events.next_time_defined != 0;
    *next_time = events.next_time;
    return OK;
}

EXCHANGE(GetNumberOfEventIndicators, ANY, (void *instance, size_t *n), give(c, n, EVENTS))
EXCHANGE(GetNumberOfContinuousStates, ANY, (void *instance, size_t *n), give(c, n, N))

/* -- co-simulation ------------------------------------------------------------------------ */

CALL(EnterStepMode, ANY, ALONE,
     refuse(c, "fmi3EnterStepMode was called; there is no event mode to leave"))

EXPORT(fmi3Status)
NAMED(fmi3DoStep)(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_way_back,
                  fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                  fmi3Float64 *last_time)
{
    Status status;
    CHECK_KIND(STEPPING, "fmi3DoStep", 0);
    if (!event_needed || !terminate || !early_return || !last_time)
        return refuse(c, "a null pointer was given for what a step leads to");
    *event_needed = *terminate = *early_return = false;
    status = take_step(c, time, step);
    *last_time = status == OK ? c->end : time;
    return status;
}
