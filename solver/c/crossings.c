/* Crossings of a plane by a motion, and the extremes of its states. */
#include "tangents.h"

#define STRIDES 512 /* parts of a walk: a motion does not cross a plane twice in one of them */
#define NEARLY (1.0 - 1e-9) /* of a step: just before the event at its end */
#define SOUGHT 4            /* repetitions of a step for one extreme */
#define CLOSE 0.05          /* share of a range: a cubic's extreme so near its end may be new */

/* A motion, and its last step: from t by h, with the state and u as they were at its start. */
typedef struct {
    const System *s;
    const Crossings *c;
    Integrator walk;
    void *work;
    Info *info;
    double t, h;
    double *before, *held;
} Motion;

/* Repeat a part of the step, from its start. */
static void repeat(const Motion *m, double part, double *x, double *u)
{
    Info info = *m->info;
    info.next_step = 0.0;
    memcpy(x, m->before, (size_t)m->s->states * sizeof(double));
    memcpy(u, m->held, (size_t)m->s->held * sizeof(double));
    m->walk(m->s, m->t, m->t + part, x, u, m->c->p, m->c->atol, m->c->rtol, m->work, &info,
            m->c->max_steps);
}

/* Repeat the step up to the crossing of the plane: regula falsi with the halving of the Illinois
 * method. `state` and `mode` are those at the step's end, and then those at the crossing, never
 * before it; for a jump across the plane, those after it. `trial` has room for both. Returns the
 * length of this part of the step. */
static double meet(const Motion *m, double *state, double *mode, double *trial)
{
    const Crossings *const c = m->c;
    const int n = m->s->states, at = c->coordinate;
    const double near = 1e-3 * c->atol[at];
    double a = 0.0, fa = m->before[at] - c->level;
    double b = m->h, fb = state[at] - c->level;
    for (int round = 0; round < 60; round++) {
        if (state[at] - c->level <= near || b - a <= 1e-15 * m->t)
            break;
        const double q = b - fb * (b - a) / (fb - fa);
        repeat(m, q, trial, trial + n);
        const double f = trial[at] - c->level;
        if (f < -near) {
            a = q;
            fa = f;
            fb *= 0.5;
        } else {
            trial[at] = larger(trial[at], c->level);
            memcpy(state, trial, (size_t)n * sizeof(double));
            memcpy(mode, trial + n, (size_t)m->s->held * sizeof(double));
            b = q;
            fb = f;
            fa *= 0.5;
        }
    }
    return b;
}

static void spread_to(const Crossings *c, const double *x, int n)
{
    for (int i = 0; i < n; i++) {
        c->low[i] = smaller(c->low[i], x[i]);
        c->high[i] = larger(c->high[i], x[i]);
    }
}

/* Place of the extreme of a cubic through `first` and `last`; its slopes at the ends, per whole
 * step, have different signs. */
static double turning(double first, double slope0, double last, double slope1)
{
    double a = 0.0, b = 1.0;
    for (int round = 0; round < 50; round++) {
        const double q = 0.5 * (a + b);
        const double slope = slope0 * (1.0 - q) * (1.0 - 3.0 * q) + slope1 * q * (3.0 * q - 2.0) +
                             6.0 * q * (1.0 - q) * (last - first);
        if (slope * slope0 > 0.0)
            a = q;
        else
            b = q;
    }
    return 0.5 * (a + b);
}

/* Widen the range of each state to its extremes within the step: if its rate changes sign, Hermite's
 * cubic gives the approximate time, and the step is repeated up to there, then up to the time from
 * the rates themselves, until this moves the extreme by less than the tolerance. `event`: whether
 * one has ended the step. `memory` has room for five rows of states, and for u. */
static void seek_extremes(const Motion *m, int event, double *memory)
{
    const System *const s = m->s;
    const Crossings *const c = m->c;
    const int n = s->states;
    const double t = m->t, h = m->h, *const before = m->before;
    double *const last = memory, *const slope0 = last + n, *const slope1 = slope0 + n;
    double *const trial = slope1 + n, *const slope = trial + n, *const mode = slope + n;
    memcpy(last, c->x, (size_t)n * sizeof(double));
    if (event) /* its effect on the states is not part of the step */
        repeat(m, NEARLY * h, last, mode);
    memcpy(mode, m->held, (size_t)s->held * sizeof(double));
    s->rhs(s, t, before, mode, c->p, slope0);
    s->rhs(s, t + h, last, mode, c->p, slope1);
    for (int i = 0; i < n; i++) {
        if (!(slope0[i] * slope1[i] < 0.0))
            continue;
        double q = turning(before[i], h * slope0[i], last[i], h * slope1[i]), top;
        hermite(1, q, h, before + i, slope0 + i, last + i, slope1 + i, &top);
        const double near = CLOSE * (c->high[i] - c->low[i]);
        if (slope0[i] > 0.0 ? top < c->high[i] - near : top > c->low[i] + near)
            continue;
        double a = 0.0, fa = slope0[i], b = 1.0, fb = slope1[i];
        for (int round = 0; round < SOUGHT && a < q && q < b; round++) {
            repeat(m, q * h, trial, mode);
            spread_to(c, trial, n);
            s->rhs(s, t + q * h, trial, mode, c->p, slope);
            if (slope[i] * fa > 0.0) {
                a = q;
                fa = slope[i];
            } else {
                b = q;
                fb = slope[i];
            }
            const double next = a + fa * (b - a) / (fa - fb);
            const double gain = 0.5 * fabs(slope[i] * (next - q) * h);
            if (!(gain > c->atol[i] + c->rtol * fabs(trial[i])))
                break;
            q = next;
        }
    }
}

/* Keep a crossing at this time. */
static void keep(const Crossings *c, int found, double t, const double *state, int n)
{
    c->times[found] = t;
    memcpy(c->states + found * n, state, (size_t)n * sizeof(double));
}

/* Walk from t0 towards t1 until `times` is full of crossings; returns their number. */
static int cross(Motion *m, double *memory)
{
    const System *const s = m->s;
    const Crossings *const c = m->c;
    Info *const info = m->info;
    const int n = s->states, at = c->coordinate;
    const size_t size = (size_t)n * sizeof(double), held_size = (size_t)s->held * sizeof(double);
    double *const again = memory + n, *const mode = again + n + s->held;
    double *const sampled = mode + s->held, *const trial = sampled + n;
    m->before = memory;
    m->held = again + n;
    const double longest = c->most ? (c->t1 - c->t0) / STRIDES : c->t1 - c->t0;
    const double least = SMALLEST * larger(fabs(c->t0), fabs(c->t1));
    Crowd crowd = {-HUGE_VAL, 0}; /* a walk of one step cannot count many events */
    double t = c->t0, until = c->t1;
    int found = 0;
    memcpy(c->low, c->x, size);
    memcpy(c->high, c->x, size);
    memcpy(sampled, c->x, size);
    for (int round = 0; round < c->max_steps && t < c->t1 && (found < c->most || !c->most);
         round++) {
        if (c->period > 0.0 && (t == c->t0 || t == until)) {
            if (sample_instant(t, c->period, 1) == t) {
                s->react(s, t, c->x, c->u, c->p, SAMPLE);
                round = 0; /* steps are counted from sample to sample */
            }
            until = sample_instant(t, c->period, 0);
            if (until > c->t1 || c->t1 - until <= SAME_INSTANT * c->period)
                until = c->t1;
        }
        memcpy(m->before, c->x, size);
        memcpy(m->held, c->u, held_size);
        const double events = info->events;
        const int status = m->walk(s, t, smaller(until, t + longest), c->x, c->u, c->p, c->atol,
                                   c->rtol, m->work, info, 1);
        const int event = info->events > events;
        info->status = status;
        if (event && crowded(&crowd, info->reached, least))
            info->status = CHATTER;
        else if ((status == DONE || status == TOO_MANY_STEPS) && diverged(c->x, c->bound, n))
            info->status = DIVERGED;
        if (info->status != DONE && info->status != TOO_MANY_STEPS)
            return found;
        double reached = info->reached;
        m->t = t;
        m->h = reached - t;
        spread_to(c, c->x, n);
        if (reached > t)
            seek_extremes(m, event, trial + n + s->held);
        if (c->period > 0.0) {
            /* motions of a sampled system can be compared only at their samples */
            if (reached == until && sample_instant(until, c->period, 1) == until) {
                if (found < c->most && sampled[at] < c->level && c->level <= c->x[at])
                    keep(c, found++, reached, c->x, n);
                memcpy(sampled, c->x, size);
            }
        } else if (m->before[at] < c->level && c->level <= c->x[at]) {
            memcpy(again, c->x, size);
            memcpy(mode, c->u, held_size);
            const double q = meet(m, again, mode, trial);
            keep(c, found++, t + q, again, n);
            if (found == c->most) { /* the motion ends at the crossing, not at the step's end */
                memcpy(c->x, again, size);
                memcpy(c->u, mode, held_size);
                reached = t + q;
            }
        }
        t = reached;
    }
    info->status = t >= c->t1 || (c->most && found == c->most) ? DONE : TOO_MANY_STEPS;
    info->reached = t;
    return found;
}

static int stiffly(const System *s, double t0, double t1, double *x, double *u, const double *p,
                   const double *atol, double rtol, void *work, Info *info, int max_steps)
{
    return integrate(s, t0, t1, x, u, p, atol, rtol, work, info, max_steps);
}

/* Crossings of a plane by the stiff stepper, or explicitly; the latter may end with STIFF. */
static int returns(const System *s, const Crossings *c, int explicitly, Info *info)
{
    const int n = s->states;
    const size_t own = explicitly ? EXPLICIT_DOUBLES(n) : WORK_DOUBLES(n, s->events);
    double *const memory = calloc(own + 9 * (size_t)n + 4 * (size_t)s->held, sizeof(double));
    if (!memory) {
        info->status = NO_MEMORY;
        return 0;
    }
    Work work;
    Explicit pair;
    if (explicitly)
        lay_explicit(&pair, n, memory);
    else
        lay_work(&work, n, s->events, memory);
    Motion motion = {.s = s, .c = c, .info = info};
    motion.walk = explicitly ? explicitly_on : stiffly;
    motion.work = explicitly ? (void *)&pair : &work;
    const int found = cross(&motion, memory + own);
    free(memory);
    return found;
}
