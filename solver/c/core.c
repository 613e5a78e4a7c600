/* The compiled core, one library: the functions for `core.py`.
 *
 * All others are hidden, so that two versions of the library, or a host with functions of the same
 * names, can be in one process. */
#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

#include <stdlib.h>

#include "stepper.c"
#include "propagation.c"
#include "explicit.c"
#include "tangents.c"
#include "crossings.c"
#include "tape.c"

/* A system of tapes or compiled equations with the memory to solve it: a block that is not moved.
 * Its address is that of the system. */
typedef struct {
    System system;
    Equations equations;
    Delays delays;
    Work work;
    double memory[];
} Solver;

/* Parts of recorded tapes, see `tape.py`: lengths and numbers of constants of each function begin at
 * SIZES, then come all constants, then all operations. */
enum { STATES, HELD, EVENTS, DELAYED, FIRST_DELAYED, SIZES };
#define FUNCTIONS (sizeof(Equations) / sizeof(Tape))
#define TAPE_HEAD (SIZES + 2 * FUNCTIONS + 1)

/* Bytes of a solver of these tapes. */
API int64_t core_size(const int32_t *tapes)
{
    const int n = tapes[STATES];
    const size_t numbers = WORK_DOUBLES(n, tapes[EVENTS]) + DELAYS_DOUBLES(n, tapes[DELAYED]);
    return (int64_t)(sizeof(Solver) + numbers * sizeof(double));
}

/* Make a solver of tapes, which are not moved either; `fill` puts compiled equations in their
 * place, if it is not null. */
API void core_make(Solver *solver, const int32_t *tapes, void (*fill)(System *))
{
    System *const s = &solver->system;
    Tape *const tape = &solver->equations.rhs;
    const int32_t *const sizes = tapes + SIZES;
    const double *constants = (const double *)(tapes + TAPE_HEAD);
    const Operation *operations = (const Operation *)constants;
    for (size_t k = 0; k < FUNCTIONS; k++)
        operations = (const Operation *)((const double *)operations + sizes[2 * k + 1]);
    for (size_t k = 0; k < FUNCTIONS; k++) {
        tape[k] = (Tape){operations, constants, sizes[2 * k + 1]};
        operations += sizes[2 * k];
        constants += sizes[2 * k + 1];
    }
    s->states = tapes[STATES];
    s->held = tapes[HELD];
    s->events = tapes[EVENTS];
    play_tapes(s, &solver->equations);
    if (fill)
        fill(s);
    double *const memory = solver->memory + WORK_DOUBLES(s->states, s->events);
    if (tapes[DELAYED] > 0)
        lay_delays(s, &solver->delays, tapes[DELAYED], tapes[FIRST_DELAYED], memory);
    lay_work(&solver->work, s->states, s->events, solver->memory);
}

/* Numbers in a history of delayed signals with room for so many steps. */
API int64_t core_history_size(const Solver *solver, int64_t room)
{
    const int count = solver->delays.count;
    return HISTORY_HEAD(count, solver->system.held) + room * STEP_SIZE(count);
}

API void core_remember(Solver *solver, double *history) { solver->delays.history = history; }

#define EVALUATED(function) \
    API void core_##function(GIVEN, double *result) { s->function(s, t, x, u, p, result); }

EVALUATED(rhs)
EVALUATED(out)
EVALUATED(sample)
EVALUATED(indicate)

API void core_jac(GIVEN, double *J, double *ft) { s->jac(s, t, x, u, p, J, ft); }

API int core_settle(Solver *solver, double t, double *x, double *u, const double *p, Info *info)
{
    return settle(&solver->system, t, x, u, p, &solver->work, info);
}

API int core_integrate(Solver *solver, double t0, double t1, double *x, double *u, const double *p,
                       const double *atol, double rtol, Info *info, int max_steps)
{
    return integrate(&solver->system, t0, t1, x, u, p, atol, rtol, &solver->work, info, max_steps);
}

/* A solver with the vectors of its motion, which are not moved; as in `core.py`. */
typedef struct {
    Solver *solver;
    double *x, *u, *y;
    const double *p, *atol;
    Info *info;
} Instance;

API int core_step(const Instance *i, double t0, double t1, double rtol, int max_steps)
{
    const int status =
        core_integrate(i->solver, t0, t1, i->x, i->u, i->p, i->atol, rtol, i->info, max_steps);
    for (int k = 0; status == DONE && k < i->solver->system.states; k++)
        if (!isfinite(i->x[k]))
            return NOT_FINITE;
    return status;
}

API void core_output(const Instance *i, double t)
{
    core_out(&i->solver->system, t, i->x, i->u, i->p, i->y);
}

/* Write states and outputs, one row for each time of a grid; the first state is given; returns the
 * number of rows that were reached.
 *
 * It begins with `row`; the state in a row after the first has been followed up to the time t.
 * `within` and `after`, if not null, are rows with the values of the first `given` of u before each
 * time and at it. Times may occur twice. `samples`, if not null, marks rows at sample instants:
 * the `sampled` discrete states, from `first` on in u, are updated there before the outputs. */
API int core_trajectory(Solver *solver, int row, double t, const double *times, int rows,
                        double *states, double *outputs, int output_count, const double *within,
                        const double *after, int given, const unsigned char *samples, int first,
                        int sampled, double *u, const double *p, const double *atol, double rtol,
                        Info *info, int max_steps)
{
    const System *const s = &solver->system;
    const int n = s->states, begun = row;
    double next[sampled > 0 ? sampled : 1];
    const size_t size = (size_t)n * sizeof *states, taken = (size_t)given * sizeof *u;
    for (; row < rows; t = times[row++]) {
        double *const x = states + (size_t)row * n;
        if (row > begun) {
            memcpy(x, x - n, size);
            if (given)
                memcpy(u, within + (size_t)row * given, taken);
        }
        if (times[row] > t) {
            info->status =
                core_integrate(solver, t, times[row], x, u, p, atol, rtol, info, max_steps);
            if (info->status != DONE)
                return row;
        }
        if (given)
            memcpy(u, after + (size_t)row * given, taken);
        if (samples && samples[row]) {
            s->sample(s, times[row], x, u, p, next);
            memcpy(u + first, next, (size_t)sampled * sizeof *u);
        }
        s->out(s, times[row], x, u, p, outputs + (size_t)row * output_count);
    }
    return rows;
}

API int core_spectrum(const System *s, const Walk *walk, int explicitly, Info *info)
{
    return explicitly ? explicit_spectrum(s, walk, info) : spectrum(s, walk, info);
}

API int core_returns(const System *s, const Crossings *crossings, int explicitly, Info *info)
{
    return returns(s, crossings, explicitly, info);
}
