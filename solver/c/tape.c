/* Equations as a list of operations, for systems without compiled equations: every number is that
 * of the same equations in C, operation by operation. */
#include "system.h"

#define MOST_REGISTERS 8192

#define EACH_OPERATION(X)                                                                     \
    X(ADD) X(SUBTRACT) X(MULTIPLY) X(DIVIDE) X(NEGATE) X(POWER) X(MODULO)                     \
    X(LESS) X(LESS_EQUAL) X(EQUAL) X(NOT_EQUAL) X(AND) X(OR) X(NOT) X(LARGER) X(SMALLER)      \
    X(SELECT)                /* a where c is not 0, else b */                                 \
    X(CALL_1) X(CALL_2)      /* function number c of one argument, of two */                  \
    X(LOAD) X(STORE)         /* element b of vector a; to it from register c */               \
    X(JUMP) X(JUMP_UNLESS)   /* to operation a + 65536 b; unless c */                         \
    X(RETURN) X(DIFFERENCES) /* c; for a Jacobian, from sizes of the states as constants */
#define NUMBER(name) name,
#define LABEL(name) &&name,
enum { EACH_OPERATION(NUMBER) };

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
    Tape rhs, jac, out, sample, indicate, kind, react, slopes, delayed;
} Equations;

/* By number; solver/tape.py has their names in the same order. */
static double (*const OF_ONE[])(double) = {
    acos, acosh, asin, asinh, atan, atanh, ceil, cos, cosh, erf, erfc, exp, expm1, fabs, floor,
    lgamma, log, log10, log1p, log2, sin, sinh, sqrt, tan, tanh, tgamma,
};
static double (*const OF_TWO[])(double, double) = {atan2, copysign, fmod, hypot, pow};

#define SHIFT 1e-8 /* of a difference, as a share of the size */

/* Each operation jumps to the next itself: a common switch is foreseen badly by processors. */
#define NEXT goto *TO[(++o)->operation]
#define THEN(result) r[o->to] = (result); NEXT

static double play(const Tape *tape, double t, int event, double *const vectors[VECTORS])
{
    static const void *const TO[] = {EACH_OPERATION(LABEL)};
    double r[MOST_REGISTERS];
    const Operation *o = tape->operations;
    r[TIME_REGISTER] = t;
    r[EVENT_REGISTER] = event;
    memcpy(r + FIRST_CONSTANT, tape->constants, (size_t)tape->constant_count * sizeof(double));
    goto *TO[o->operation];
    ADD: THEN(r[o->a] + r[o->b]);
    SUBTRACT: THEN(r[o->a] - r[o->b]);
    MULTIPLY: THEN(r[o->a] * r[o->b]);
    DIVIDE: THEN(r[o->a] / r[o->b]);
    NEGATE: THEN(-r[o->a]);
    POWER: THEN(pow(r[o->a], r[o->b]));
    MODULO: THEN(modulo(r[o->a], r[o->b]));
    LESS: THEN(r[o->a] < r[o->b]);
    LESS_EQUAL: THEN(r[o->a] <= r[o->b]);
    EQUAL: THEN(r[o->a] == r[o->b]);
    NOT_EQUAL: THEN(r[o->a] != r[o->b]);
    AND: THEN(r[o->a] != 0.0 && r[o->b] != 0.0);
    OR: THEN(r[o->a] != 0.0 || r[o->b] != 0.0);
    NOT: THEN(r[o->a] == 0.0);
    LARGER: THEN(larger(r[o->a], r[o->b]));
    SMALLER: THEN(smaller(r[o->a], r[o->b]));
    SELECT: THEN(r[o->c] != 0.0 ? r[o->a] : r[o->b]);
    CALL_1: THEN(OF_ONE[o->c](r[o->a]));
    CALL_2: THEN(OF_TWO[o->c](r[o->a], r[o->b]));
    LOAD: THEN(vectors[o->a][o->b]);
    STORE: vectors[o->a][o->b] = r[o->c]; NEXT;
    JUMP: o = tape->operations + o->a + 65536 * o->b - 1; NEXT;
    JUMP_UNLESS: if (r[o->c] == 0.0) goto JUMP; NEXT;
    RETURN: DIFFERENCES: return r[o->c];
}

/* A tape only reads the vectors that its function must not write. */
#define VECTORS_OF(x, u, p, ...) ((double *const[VECTORS]){(double *)(x), (double *)(u), (double *)(p), __VA_ARGS__})
#define TAPES ((const Equations *)s->equations)
#define PLAY(function)                                                   \
    static void play_##function(GIVEN, double *result)                   \
    {                                                                    \
        play(&TAPES->function, t, 0, VECTORS_OF(x, u, p, result));       \
    }

PLAY(rhs)
PLAY(out)
PLAY(sample)
PLAY(indicate)
PLAY(delayed)

/* The Jacobian of rates whose slopes are not known. */
static void by_differences(GIVEN, const double *nominal, double *J, double *ft)
{
    const int n = s->states;
    double here[n + 1], moved[n + 1], beside[n + 1];
    memcpy(moved, x, (size_t)n * sizeof *x);
    s->rhs(s, t, x, u, p, here);
    for (int j = 0; j < n; j++) {
        const double step = SHIFT * larger(fabs(x[j]), nominal[j]);
        moved[j] = x[j] + step;
        s->rhs(s, t, moved, u, p, beside);
        for (int i = 0; i < n; i++)
            J[i * n + j] = (beside[i] - here[i]) / step;
        moved[j] = x[j];
    }
    const double step = SHIFT * larger(fabs(t), 1.0);
    s->rhs(s, t + step, x, u, p, beside);
    for (int i = 0; i < n; i++)
        ft[i] = (beside[i] - here[i]) / step;
}

static void play_jac(GIVEN, double *J, double *ft)
{
    if (TAPES->jac.operations->operation == DIFFERENCES)
        by_differences(s, t, x, u, p, TAPES->jac.constants, J, ft);
    else
        play(&TAPES->jac, t, 0, VECTORS_OF(x, u, p, J, ft));
}

static int play_kind(const System *s, const double *u, int k)
{
    return (int)play(&TAPES->kind, 0.0, k, VECTORS_OF(NULL, u, NULL, NULL));
}

static void play_react(const System *s, double t, double *x, double *u, const double *p, int k)
{
    play(&TAPES->react, t, k, VECTORS_OF(x, u, p, NULL));
}

static double play_slopes(GIVEN, int k, double *gradient, double *R, double *Rt)
{
    return play(&TAPES->slopes, t, k, VECTORS_OF(x, u, p, gradient, R, Rt));
}

/* Make a system of tapes, which must not be moved in memory while it is used. */
static void play_tapes(System *s, const Equations *equations)
{
    s->equations = equations;
    s->rhs = play_rhs;
    s->jac = play_jac;
    s->out = play_out;
    s->sample = play_sample;
    s->indicate = play_indicate;
    s->kind = play_kind;
    s->react = play_react;
    s->slopes = play_slopes;
    s->delayed = play_delayed;
}
