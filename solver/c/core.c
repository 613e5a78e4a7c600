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
#include "tape.c"

API void core_play_tapes(System *s, const Equations *equations) { play_tapes(s, equations); }

API void core_lay_work(Work *work, int n, int events, double *memory)
{
    lay_work(work, n, events, memory);
}

API void core_lay_delays(System *s, Delays *delays, int count, int first, double *memory)
{
    lay_delays(s, delays, count, first, memory);
}

API int core_settle(const System *s, double t, double *x, double *u, const double *p, Work *work,
                    Info *info)
{
    return settle(s, t, x, u, p, work, info);
}

API int core_integrate(const System *s, double t0, double t1, double *x, double *u,
                       const double *p, const double *atol, double rtol, Work *work, Info *info,
                       int max_steps)
{
    return integrate(s, t0, t1, x, u, p, atol, rtol, work, info, max_steps);
}

/* A system with its memory, which is not moved; as in `core.py`. */
typedef struct {
    const System *system;
    Work *work;
    double *x, *u, *y;
    const double *p, *atol;
    Info *info;
} Instance;

API int core_step(const Instance *i, double t0, double t1, double rtol, int max_steps)
{
    const int status = integrate(i->system, t0, t1, i->x, i->u, i->p, i->atol, rtol, i->work,
                                 i->info, max_steps);
    for (int k = 0; status == DONE && k < i->system->states; k++)
        if (!isfinite(i->x[k]))
            return NOT_FINITE;
    return status;
}

API void core_output(const Instance *i, double t)
{
    i->system->out(i->system, t, i->x, i->u, i->p, i->y);
}

/* Write states and outputs, one row for each time of a grid; the first state is given; returns the
 * number of rows that were reached.
 *
 * `within` and `after`, if not null, are rows with the values of the first `given` of u before each
 * time and at it. Times may occur twice. `samples`, if not null, marks rows at sample instants:
 * the `sampled` discrete states, from `first` on in u, are updated there before the outputs. */
API int core_trajectory(const System *s, const double *times, int rows, double *states,
                        double *outputs, int output_count, const double *within,
                        const double *after, int given, const unsigned char *samples, int first,
                        int sampled, double *u, const double *p, const double *atol, double rtol,
                        Work *work, Info *info, int max_steps)
{
    const int n = s->states;
    double next[sampled > 0 ? sampled : 1];
    const size_t size = (size_t)n * sizeof *states, taken = (size_t)given * sizeof *u;
    for (int row = 0; row < rows; row++) {
        double *const x = states + (size_t)row * n;
        if (row > 0) {
            memcpy(x, x - n, size);
            if (given)
                memcpy(u, within + (size_t)row * given, taken);
            if (times[row] > times[row - 1]) {
                info->status = integrate(s, times[row - 1], times[row], x, u, p, atol, rtol,
                                         work, info, max_steps);
                if (info->status != DONE)
                    return row;
            }
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
