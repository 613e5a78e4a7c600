/* Equations as a list of operations, for systems without compiled equations: every number is that
 * of the same equations in C, operation by operation. */
#ifndef TAPE_H
#define TAPE_H

#include "system.h"

#define MOST_REGISTERS 8192

enum {
    ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, POWER, MODULO,
    LESS, LESS_EQUAL, EQUAL, NOT_EQUAL, AND, OR, NOT,
    LARGER, SMALLER, SELECT, /* a where c is not 0, else b */
    CALL_1, CALL_2,          /* function number c of one argument, of two */
    LOAD, STORE,             /* element b of vector a; from or to register c */
    JUMP, JUMP_UNLESS,       /* to operation a + 65536 b; unless c */
    RETURN,                  /* c */
    DIFFERENCES              /* instead of a Jacobian; the constants are sizes of the states */
};

/* Vectors of a tape. */
enum { X, U, P, FIRST_RESULT, SECOND_RESULT, THIRD_RESULT, VECTORS };

/* Registers with initial values: the time and the number of an event, then constants. */
enum { TIME_REGISTER, EVENT_REGISTER, FIRST_CONSTANT };

typedef struct {
    uint16_t operation, to, a, b, c;
} Operation;

typedef struct {
    const Operation *operations;
    const double *constants;
    int32_t constant_count;
} Tape;

/* The tapes of a system's functions, in the order of `System`. */
typedef struct {
    Tape rhs, jac, out, sample, indicate, spread, kind, react, slopes, delayed;
} Equations;

/* Make a system of tapes, which must not be moved in memory while it is used. */
static void play_tapes(System *s, const Equations *equations);

#endif
