/* FMI 3.0, co-simulation and model exchange: the names and rules of that version around one
 * component. This is the one file to compile; it includes all others. */
#include "model.h"

#include "system.h"
#include "equations.h"
#include "component.h"
#include "fmi3_declarations.h"

#ifdef FMI3_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI3_FUNCTION_PREFIX
#endif
#include "exported.h"

static void log_message(const Instance *c, Status status, const char *category, const char *text)
{
    ((fmi3LogMessageCallback)c->logger)(c->environment, status, category, text);
}

#define CHECK_SIZES(given, needed)                                                                 \
    if ((given) != (needed))                                                                       \
        return refuse(c, "there is room for %lu values, %lu are needed", (unsigned long)(given),   \
                      (unsigned long)(needed))

/* -- life cycle --------------------------------------------------------------------------- */

EXPORT(const char *) NAMED(fmi3GetVersion)(void) { return "3.0"; }

static Instance *instantiate(fmi3String name, fmi3String token, int exchange, const char *wrong,
                             fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    Instance *c;
    if (!name || !name[0])
        wrong = "an instance needs a name";
    else if (!token || strcmp(token, TOKEN))
        wrong = "the instantiation token is not that of " MODEL ", version " TOKEN
                "; the model description belongs to another FMU";
    if (wrong) {
        if (log)
            log(environment, ERROR, "logStatusError", wrong);
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

/* Every accepted step is told; inputs are held in all of a step, so that none are asked for. */
static void update_host(Instance *c, double t)
{
    const bool may_return = c->may_return && t < c->end;
    fmi3Boolean requested = false;
    fmi3Float64 until = t;
    ((fmi3IntermediateUpdateCallback)c->updater)(c->environment, t, false, true, true, may_return,
                                                 &requested, &until);
    if (may_return && requested && !(until >= c->end))
        c->end = larger(t, until); /* t where it is not a number */
}

EXPORT(fmi3Instance)
NAMED(fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                    fmi3Boolean visible, fmi3Boolean logging,
                                    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)resources;
    (void)visible;
    (void)logging; /* there are only errors to tell */
    return instantiate(name, token, 1, CAN_EXCHANGE ? NULL : MODEL " is not for model exchange",
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
    Instance *c;
    (void)resources;
    (void)visible;
    (void)logging;
    if (event_mode)
        wrong = MODEL " has no event mode in co-simulation; its events happen within the steps";
    else if (required_count && !required)
        wrong = "a null pointer was given for the required intermediate variables";
    c = instantiate(name, token, 0, wrong, environment, log);
    if (!c)
        return NULL;
    for (size_t k = 0; k < required_count; k++) {
        const Variable *v = variable(c, required[k]);
        if (v && !v->intermediate)
            refuse(c, "%s cannot be an intermediate variable", v->name);
        if (!v || !v->intermediate) {
            free_instance(c);
            return NULL;
        }
        c->wanted[required[k]] = 1;
    }
    if (update) {
        c->updater = (void (*)(void))update;
        c->update = update_host;
        c->may_return = early_return;
    }
    return c;
}

EXPORT(fmi3Instance)
NAMED(fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                         fmi3LockPreemptionCallback lock,
                                         fmi3UnlockPreemptionCallback unlock)
{
    (void)resources;
    (void)visible;
    (void)logging;
    (void)update;
    (void)lock;
    (void)unlock;
    return instantiate(name, token, 0, MODEL " is not for scheduled execution", environment, log);
}

EXPORT(void) NAMED(fmi3FreeInstance)(fmi3Instance instance)
{
    Instance *c = instance;
    if (c && allowed(c, ANY, "fmi3FreeInstance"))
        free_instance(c);
}

EXPORT(fmi3Status)
NAMED(fmi3SetDebugLogging)(fmi3Instance instance, fmi3Boolean on, size_t n,
                           const fmi3String categories[])
{
    CHECK(ANY | UPDATING, "fmi3SetDebugLogging");
    (void)on;
    (void)n;
    (void)categories;
    return OK;
}

EXPORT(fmi3Status)
NAMED(fmi3EnterInitializationMode)(fmi3Instance instance, fmi3Boolean has_tolerance,
                                   fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean has_stop,
                                   fmi3Float64 stop)
{
    CHECK(INSTANTIATED, "fmi3EnterInitializationMode");
    (void)has_stop;
    (void)stop;
    if (begin(c, has_tolerance, tolerance, start) != OK)
        return ERROR;
    c->now.phase = INITIALIZING;
    return OK;
}

EXPORT(fmi3Status) NAMED(fmi3ExitInitializationMode)(fmi3Instance instance)
{
    CHECK(INITIALIZING, "fmi3ExitInitializationMode");
    return end_initialization(c);
}

EXPORT(fmi3Status) NAMED(fmi3Terminate)(fmi3Instance instance)
{
    CHECK(RUNNING, "fmi3Terminate");
    c->now.phase = TERMINATED;
    return OK;
}

EXPORT(fmi3Status) NAMED(fmi3Reset)(fmi3Instance instance)
{
    CHECK(ANY, "fmi3Reset");
    back_to_start(c);
    return OK;
}

/* -- variables ---------------------------------------------------------------------------- */

EXPORT(fmi3Status)
NAMED(fmi3GetFloat64)(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                      fmi3Float64 values[], size_t room)
{
    CHECK(ANY | UPDATING, "fmi3GetFloat64");
    CHECK_SIZES(room, n);
    return get_numbers(c, references, n, values);
}

EXPORT(fmi3Status)
NAMED(fmi3SetFloat64)(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                      const fmi3Float64 values[], size_t room)
{
    CHECK(ALIVE, "fmi3SetFloat64");
    CHECK_SIZES(room, n);
    return set_numbers(c, references, n, values);
}

EXPORT(fmi3Status)
NAMED(fmi3GetString)(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                     fmi3String values[], size_t room)
{
    CHECK(ANY, "fmi3GetString");
    CHECK_SIZES(room, n);
    if (n && (!references || !values))
        return refuse(c, "a null pointer was given for %lu values", (unsigned long)n);
    for (size_t k = 0; k < n; k++) {
        if (references[k] != MESSAGE_REFERENCE)
            return refuse(c, "no String has the value reference %lu", (unsigned long)references[k]);
        values[k] = c->now.failure;
    }
    return OK;
}

/* Variables of other types: there are none. */
#define NONE_OF(call, constant, type)                                                              \
    EXPORT(fmi3Status)                                                                             \
    NAMED(call)(fmi3Instance instance, const fmi3ValueReference references[], size_t n,            \
                constant type values[], size_t room)                                               \
    {                                                                                              \
        CHECK(ANY, #call);                                                                         \
        (void)references;                                                                          \
        (void)values;                                                                              \
        (void)room;                                                                                \
        return n ? refuse(c, "%s was called for %lu values, there are none", #call,                \
                          (unsigned long)n)                                                        \
                 : OK;                                                                             \
    }
#define NONE_EITHER_WAY(type)                                                                      \
    NONE_OF(fmi3Get##type, , fmi3##type)                                                           \
    NONE_OF(fmi3Set##type, const, fmi3##type)
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
NONE_OF(fmi3SetString, const, fmi3String)

/* The same for functions with arguments of their own. */
#define REFUSED(call, arguments, what)                                                             \
    EXPORT(fmi3Status) NAMED(call) arguments                                                       \
    {                                                                                              \
        CHECK(ANY, #call);                                                                         \
        return n ? refuse(c, "%s was called; there are no " what, #call) : OK;                     \
    }
#define LIST fmi3Instance instance, const fmi3ValueReference r[], size_t n
#if defined __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
REFUSED(fmi3GetBinary, (LIST, size_t s[], fmi3Binary v[], size_t m), "binary variables")
REFUSED(fmi3SetBinary, (LIST, const size_t s[], const fmi3Binary v[], size_t m), "binary variables")
REFUSED(fmi3GetClock, (LIST, fmi3Clock v[]), "clocks")
REFUSED(fmi3SetClock, (LIST, const fmi3Clock v[]), "clocks")
REFUSED(fmi3GetIntervalDecimal, (LIST, fmi3Float64 v[], fmi3IntervalQualifier q[]), "clocks")
REFUSED(fmi3GetIntervalFraction,
        (LIST, fmi3UInt64 v[], fmi3UInt64 w[], fmi3IntervalQualifier q[]), "clocks")
REFUSED(fmi3GetShiftDecimal, (LIST, fmi3Float64 v[]), "clocks")
REFUSED(fmi3GetShiftFraction, (LIST, fmi3UInt64 v[], fmi3UInt64 w[]), "clocks")
REFUSED(fmi3SetIntervalDecimal, (LIST, const fmi3Float64 v[]), "clocks")
REFUSED(fmi3SetIntervalFraction, (LIST, const fmi3UInt64 v[], const fmi3UInt64 w[]), "clocks")
REFUSED(fmi3SetShiftDecimal, (LIST, const fmi3Float64 v[]), "clocks")
REFUSED(fmi3SetShiftFraction, (LIST, const fmi3UInt64 v[], const fmi3UInt64 w[]), "clocks")
REFUSED(fmi3GetOutputDerivatives, (LIST, const fmi3Int32 o[], fmi3Float64 v[], size_t m),
        "derivatives of outputs by time")

#define NEVER(call, arguments, what)                                                               \
    EXPORT(fmi3Status) NAMED(call) arguments                                                       \
    {                                                                                              \
        CHECK(ANY, #call);                                                                         \
        return refuse(c, "%s was called; there are no " what, #call);                              \
    }
NEVER(fmi3EnterConfigurationMode, (fmi3Instance instance), "structural parameters")
NEVER(fmi3ExitConfigurationMode, (fmi3Instance instance), "structural parameters")
NEVER(fmi3ActivateModelPartition, (fmi3Instance instance, fmi3ValueReference r, fmi3Float64 t),
      "model partitions")
NEVER(fmi3GetNumberOfVariableDependencies,
      (fmi3Instance instance, fmi3ValueReference r, size_t *n), "dependencies of elements")
NEVER(fmi3GetVariableDependencies,
      (fmi3Instance instance, fmi3ValueReference r, size_t i[], fmi3ValueReference s[], size_t j[],
       fmi3DependencyKind k[], size_t n),
      "dependencies of elements")
#if defined __GNUC__
#pragma GCC diagnostic pop
#endif

/* -- state -------------------------------------------------------------------------------- */

EXPORT(fmi3Status) NAMED(fmi3GetFMUState)(fmi3Instance instance, fmi3FMUState *state)
{
    CHECK(ANY, "fmi3GetFMUState");
    return save_state(c, state);
}

EXPORT(fmi3Status) NAMED(fmi3SetFMUState)(fmi3Instance instance, fmi3FMUState state)
{
    CHECK(ANY, "fmi3SetFMUState");
    return restore_state(c, state);
}

EXPORT(fmi3Status) NAMED(fmi3FreeFMUState)(fmi3Instance instance, fmi3FMUState *state)
{
    CHECK(ANY, "fmi3FreeFMUState");
    return forget_state(c, state);
}

EXPORT(fmi3Status)
NAMED(fmi3SerializedFMUStateSize)(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    CHECK(ANY, "fmi3SerializedFMUStateSize");
    return serialized_size(c, state, size);
}

EXPORT(fmi3Status)
NAMED(fmi3SerializeFMUState)(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[],
                             size_t size)
{
    CHECK(ANY, "fmi3SerializeFMUState");
    return serialize_state(c, state, bytes, size);
}

EXPORT(fmi3Status)
NAMED(fmi3DeserializeFMUState)(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                               fmi3FMUState *state)
{
    CHECK(ANY, "fmi3DeserializeFMUState");
    return deserialize_state(c, bytes, size, state);
}

/* -- partial derivatives ------------------------------------------------------------------ */

EXPORT(fmi3Status)
NAMED(fmi3GetDirectionalDerivative)(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                    size_t n, const fmi3ValueReference knowns[], size_t m,
                                    const fmi3Float64 seed[], size_t seeds,
                                    fmi3Float64 sensitivity[], size_t room)
{
    CHECK(INITIALIZING | RUNNING, "fmi3GetDirectionalDerivative");
    CHECK_SIZES(seeds, m);
    CHECK_SIZES(room, n);
    return derivative_product(c, 0, unknowns, n, knowns, m, seed, sensitivity);
}

EXPORT(fmi3Status)
NAMED(fmi3GetAdjointDerivative)(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                size_t n, const fmi3ValueReference knowns[], size_t m,
                                const fmi3Float64 seed[], size_t seeds, fmi3Float64 sensitivity[],
                                size_t room)
{
    CHECK(INITIALIZING | RUNNING, "fmi3GetAdjointDerivative");
    CHECK_SIZES(seeds, n);
    CHECK_SIZES(room, m);
    return derivative_product(c, 1, unknowns, n, knowns, m, seed, sensitivity);
}

/* -- model exchange ----------------------------------------------------------------------- */

EXPORT(fmi3Status) NAMED(fmi3EnterEventMode)(fmi3Instance instance)
{
    CHECK_KIND(EVENT | CONTINUOUS, "fmi3EnterEventMode", 1);
    c->now.phase = EVENT;
    return OK;
}

EXPORT(fmi3Status) NAMED(fmi3EvaluateDiscreteStates)(fmi3Instance instance)
{
    CHECK_KIND(INITIALIZING | EVENT, "fmi3EvaluateDiscreteStates", 1);
    return OK;
}

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

EXPORT(fmi3Status) NAMED(fmi3EnterContinuousTimeMode)(fmi3Instance instance)
{
    CHECK_KIND(EVENT, "fmi3EnterContinuousTimeMode", 1);
    c->now.phase = CONTINUOUS;
    return OK;
}

EXPORT(fmi3Status)
NAMED(fmi3CompletedIntegratorStep)(fmi3Instance instance, fmi3Boolean no_way_back,
                                   fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    CHECK_KIND(CONTINUOUS, "fmi3CompletedIntegratorStep", 1);
    (void)no_way_back;
    if (!enter_event_mode || !terminate)
        return refuse(c, "a null pointer was given for what follows a step");
    *enter_event_mode = complete_step(c) != 0;
    *terminate = false;
    return OK;
}

EXPORT(fmi3Status) NAMED(fmi3SetTime)(fmi3Instance instance, fmi3Float64 time)
{
    CHECK_KIND(EVENT | CONTINUOUS, "fmi3SetTime", 1);
    if (!isfinite(time))
        return refuse(c, "the time was set to %g, not a number", time);
    set_time(c, time);
    return OK;
}

EXPORT(fmi3Status)
NAMED(fmi3SetContinuousStates)(fmi3Instance instance, const fmi3Float64 values[], size_t n)
{
    CHECK_KIND(EVENT | CONTINUOUS, "fmi3SetContinuousStates", 1);
    return set_states(c, values, n);
}

EXPORT(fmi3Status)
NAMED(fmi3GetContinuousStateDerivatives)(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    CHECK_KIND(INITIALIZING | EVENT | CONTINUOUS | TERMINATED, "fmi3GetContinuousStateDerivatives",
               1);
    return get_derivatives(c, values, n);
}

EXPORT(fmi3Status)
NAMED(fmi3GetEventIndicators)(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    CHECK_KIND(INITIALIZING | EVENT | CONTINUOUS | TERMINATED, "fmi3GetEventIndicators", 1);
    return get_indicators(c, values, n);
}

EXPORT(fmi3Status)
NAMED(fmi3GetContinuousStates)(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    CHECK_KIND(INITIALIZING | EVENT | CONTINUOUS | TERMINATED, "fmi3GetContinuousStates", 1);
    return get_states(c, values, n);
}

EXPORT(fmi3Status)
NAMED(fmi3GetNominalsOfContinuousStates)(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    CHECK_KIND(ANY, "fmi3GetNominalsOfContinuousStates", 1);
    return get_array(c, NOMINAL, N, values, n, "nominal values");
}

#define NUMBER_OF(call, number)                                                                    \
    EXPORT(fmi3Status) NAMED(call)(fmi3Instance instance, size_t *n)                               \
    {                                                                                              \
        CHECK_KIND(ANY, #call, 1);                                                                 \
        if (!n)                                                                                    \
            return refuse(c, "a null pointer was given for a number");                             \
        *n = number;                                                                               \
        return OK;                                                                                 \
    }
NUMBER_OF(fmi3GetNumberOfEventIndicators, EVENTS)
NUMBER_OF(fmi3GetNumberOfContinuousStates, N)

/* -- co-simulation ------------------------------------------------------------------------ */

EXPORT(fmi3Status) NAMED(fmi3EnterStepMode)(fmi3Instance instance)
{
    CHECK(ANY, "fmi3EnterStepMode");
    return refuse(c, "fmi3EnterStepMode was called; there is no event mode to leave");
}

EXPORT(fmi3Status)
NAMED(fmi3DoStep)(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_way_back,
                  fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                  fmi3Float64 *last_time)
{
    Status status;
    CHECK_KIND(STEPPING, "fmi3DoStep", 0);
    (void)no_way_back;
    if (!event_needed || !terminate || !early_return || !last_time)
        return refuse(c, "a null pointer was given for what a step leads to");
    *event_needed = *terminate = *early_return = false;
    status = take_step(c, time, step);
    *early_return = status == OK && c->end < time + step;
    *last_time = status == OK ? c->end : time;
    return status;
}
