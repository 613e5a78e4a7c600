/* What a component consists of: constants, tables and equations. They are in the same file as all
 * else, or, with SEPARATE, in another one, so that what is alike in all FMUs is compiled once. */
#ifndef TABLES_H
#define TABLES_H

#include "system.h"

typedef struct {
    enum {
        NOTHING, INPUT, PARAMETER, OUTPUT, STATE,
        DERIVATIVE, MESSAGE, CLOCK, INDICATOR
    } what;
    int place; /* in the array of all numbers; of a derivative and an indicator, its number */
    const char *name, *unit;
    double low, high;
} Variable;

typedef void (*Function)(GIVEN, double *result);

#ifdef SEPARATE
#define OWN
#include "model.h"
extern const char TOKEN[];
extern const System SYSTEM;
extern const Function SPREAD, PARTIAL;
#else
#define OWN static
#include "model.h"
#include "equations.c"
#endif

#endif
