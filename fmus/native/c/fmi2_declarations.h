/* Declarations of FMI 2.0 for hosts and FMUs, as far as used here. */
#ifndef FMI2_DECLARATIONS_H
#define FMI2_DECLARATIONS_H

#include <stddef.h>

typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef int fmi2Status; /* 0 OK, 1 warning, 2 discard, 3 error, 4 fatal, 5 pending */
typedef int fmi2Type;   /* 0 model exchange, 1 co-simulation */
typedef int fmi2StatusKind; /* 0 of the step, 1 pending text, 2 last successful time, 3 terminated */

typedef struct {
    void (*logger)(void *environment, fmi2String instance, fmi2Status status, fmi2String category,
                   fmi2String message, ...);
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *object);
    void (*stepFinished)(void *environment, fmi2Status status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    fmi2Boolean newDiscreteStatesNeeded;
    fmi2Boolean terminateSimulation;
    fmi2Boolean nominalsOfContinuousStatesChanged;
    fmi2Boolean valuesOfContinuousStatesChanged;
    fmi2Boolean nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

#endif
