/* Delayed signals: their values during the accepted steps.
 *
 * The delayed signals are in u, and after all of them their rates; both are written there before
 * any function of the equations is called. A step adds a piece of each signal: its values at equal
 * distances, from the stepper's dense output of order four, with a polynomial through them. No step
 * is longer than the shortest delay, so that the required values are always known, and the stepper
 * keeps its order, which is five.
 *
 * A step begins where a derivative of order L of a signal jumps, and another one begins one delay
 * later, where the derivative of order L + 1 of the states jumps: steps end at all such instants up
 * to L = SMOOTH. */
#define PIECES 5      /* equal parts of a step, at whose ends a signal's values are kept */
#define SMOOTH 5      /* jumps of higher orders do not disturb a step */
#define NO_JUMP 99.0  /* level of a step that begins where nothing jumps */
#define SAME_TIME 1e-12 /* largest difference of equal instants, as a share of the time */
#define UNRESOLVED 1e-4 /* share of the shortest delay: shorter steps need not follow a signal */

/* Parts of a history: four numbers, each delay's duration, the held values of the last step, and
 * then per step its beginning, its level and the values of each signal. */
enum { ROOM, COUNT, END, DISTURBED, DURATIONS };
#define STEP_SIZE(count) (2 + (PIECES + 1) * (count))
#define HISTORY_HEAD(count, held) (DURATIONS + (count) + (held))

struct Delays {
    int32_t count, first; /* number of signals; place of the first in u */
    System plain;         /* the equations, which get u with the signals */
    double *history;      /* belongs to a motion, as its state does */
    double *told;         /* scratch: 4 count; what `delayed` writes */
    double *node;         /* scratch: as many as states */
};

#define DELAYS_DOUBLES(n, count) (4 * (count) + (n))

static double *step_at(const Delays *d, const System *s, int k)
{
    return d->history + HISTORY_HEAD(d->count, s->held) + (size_t)k * STEP_SIZE(d->count);
}

/* Largest difference of two times near t that count as equal. */
static double same_instant(const Delays *d, double t)
{
    return SAME_TIME * (fabs(t) + fabs(d->history[END]));
}

/* The last step that began before or at t; -1 if there is none. */
static int step_of(const System *s, double t)
{
    const Delays *const d = s->delays;
    int low = -1, high = (int)d->history[COUNT];
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (step_at(d, s, middle)[0] <= t)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* The polynomial through equidistant values, at z distances after the first; its derivative by z
 * goes to `slope`. Newton's form. */
static double through(const double *values, double z, double *slope)
{
    double c[PIECES + 1];
    memcpy(c, values, sizeof c);
    for (int order = 1; order <= PIECES; order++)
        for (int k = PIECES; k >= order; k--)
            c[k] -= c[k - 1];
    double value = c[PIECES], rate = 0.0;
    for (int k = PIECES - 1; k >= 0; k--) {
        rate = (value + (z - k) * rate) / (k + 1);
        value = c[k] + (z - k) / (k + 1) * value;
    }
    *slope = rate;
    return value;
}

/* Write the delayed signals and their rates at t into u. */
static void look_back(const System *s, double t, const double *x, const double *held,
                      const double *p)
{
    Delays *const d = s->delays;
    double *const u = (double *)held + d->first; /* no other code writes this part of u */
    const int count = (int)d->history[COUNT];
    int asked = 0;
    const double end = d->history[END], same = same_instant(d, t);
    /* at the start of a step, signals have their values after it; within it, those before */
    const double side = t <= end + same ? same : -same;
    for (int j = 0; j < d->count; j++) {
        const double then = t - d->history[DURATIONS + j];
        const int k = count > 0 ? step_of(s, then + side) : -1;
        if (k < 0) {
            if (!asked++)
                d->plain.delayed(s, t, x, held, p, d->told);
            u[j] = d->told[2 * d->count + j];
            u[d->count + j] = 0.0;
            continue;
        }
        const double *const step = step_at(d, s, k);
        const double next = k + 1 < count ? step_at(d, s, k + 1)[0] : end;
        const double share = (smaller(then, next) - step[0]) / (next - step[0]);
        double slope;
        u[j] = through(step + 2 + (PIECES + 1) * j, PIECES * share, &slope);
        u[d->count + j] = PIECES * slope / (next - step[0]);
    }
}

/* Prepare steps from t0; 0 if a delay is zero. If the motion does not continue at the end of the
 * last step, its history begins again. */
static int begin_history(const System *s, double t0, const double *x, const double *u,
                         const double *p)
{
    Delays *const d = s->delays;
    double *const h = d->history;
    d->plain.delayed(s, t0, x, u, p, d->told); /* durations and starts do not depend on signals */
    for (int j = 0; j < d->count; j++) {
        h[DURATIONS + j] = d->told[d->count + j];
        if (!(h[DURATIONS + j] > 0.0 && h[DURATIONS + j] < HUGE_VAL))
            return 0;
    }
    if (h[COUNT] == 0.0 || fabs(t0 - h[END]) > same_instant(d, t0)) {
        h[COUNT] = 0.0;
        h[END] = t0;
        h[DISTURBED] = 1.0;
    }
    return 1;
}

/* Whether there is room for one more step; steps that are older than all delays are removed. */
static int has_room(const System *s)
{
    Delays *const d = s->delays;
    double *const h = d->history;
    const int count = (int)h[COUNT];
    if (count < (int)h[ROOM])
        return 1;
    double longest = 0.0;
    for (int j = 0; j < d->count; j++)
        longest = larger(longest, h[DURATIONS + j]);
    const int kept = step_of(s, h[END] - longest - 2.0 * same_instant(d, h[END]));
    if (2 * kept < count)
        return 0;
    memmove(step_at(d, s, 0), step_at(d, s, kept),
            (size_t)(count - kept) * STEP_SIZE(d->count) * sizeof(double));
    h[COUNT] = count - kept;
    return 1;
}

/* Latest end of a step from t. */
static double latest_end(const System *s, double t, double t1)
{
    const Delays *const d = s->delays;
    const double same = 2.0 * same_instant(d, t);
    const int count = (int)d->history[COUNT];
    double end = t1;
    for (int j = 0; j < d->count; j++) {
        const double duration = d->history[DURATIONS + j];
        end = smaller(end, t + duration);
        for (int k = step_of(s, t - duration + same) + 1; k < count; k++) {
            const double *const step = step_at(d, s, k);
            if (step[1] <= SMOOTH) {
                end = smaller(end, step[0] + duration);
                break;
            }
        }
    }
    return end < t1 - same ? end : t1; /* no tiny step because of round-off */
}

/* Order of the derivative that jumps at the start of this step, from earlier steps. */
static double level_from_before(const System *s, double t)
{
    const Delays *const d = s->delays;
    const double same = 2.0 * same_instant(d, t);
    double level = NO_JUMP;
    for (int j = 0; j < d->count; j++) {
        const double then = t - d->history[DURATIONS + j];
        for (int k = step_of(s, then + same); k >= 0; k--) {
            const double *const step = step_at(d, s, k);
            if (step[0] < then - same)
                break;
            if (step[1] <= SMOOTH)
                level = smaller(level, step[1] + 1.0);
        }
    }
    return level;
}

/* Write the signals of a step from t by h after the known steps, from the stepper's memory of it.
 * Returns the error of the polynomials between their points, in units of the tolerance. */
static double follow_signals(const System *s, double t, double h, const double *x, const double *u,
                             const double *p, double rtol, const Work *work)
{
    Delays *const d = s->delays;
    double *const step = step_at(d, s, (int)d->history[COUNT]);
    const double *const nominal = d->told + 3 * d->count;
    double apart = 0.0, shortest = HUGE_VAL;
    for (int j = 0; j < d->count; j++)
        shortest = smaller(shortest, d->history[DURATIONS + j]);
    for (int k = 0; k <= PIECES + 1; k++) {
        /* the last one is a point at which the polynomials are tested */
        const double share = k <= PIECES ? (double)k / PIECES : 0.5 / PIECES;
        dense_output(s->states, share, x, work, d->node);
        s->delayed(s, t + share * h, k == 0 ? x : k == PIECES ? work->stage : d->node, u, p,
                   d->told);
        for (int j = 0; j < d->count; j++) {
            double *const values = step + 2 + (PIECES + 1) * j;
            if (k <= PIECES) {
                values[k] = d->told[j];
                continue;
            }
            double slope, size = nominal[j];
            for (int i = 0; i <= PIECES; i++)
                size = larger(size, fabs(values[i]));
            apart = larger(apart, fabs(through(values, 0.5, &slope) - d->told[j]) / (rtol * size));
        }
    }
    return h > UNRESOLVED * shortest ? apart : 0.0;
}

/* Add the step that `follow_signals` has written last to the known ones. */
static void keep_step(const System *s, double t, double end, const double *u)
{
    Delays *const d = s->delays;
    double *const history = d->history, *const last = history + DURATIONS + d->count;
    const int count = (int)history[COUNT];
    double *const step = step_at(d, s, count);
    double level = level_from_before(s, t);
    const int behind = d->first + 2 * d->count; /* place of the mode in u */
    if (history[DISTURBED] != 0.0 || memcmp(last, u, (size_t)d->first * sizeof *u) != 0 ||
        memcmp(last + behind, u + behind, (size_t)(s->held - behind) * sizeof *u) != 0)
        level = smaller(level, 1.0);
    for (int j = 0; j < d->count; j++) {
        const int at = 2 + (PIECES + 1) * j;
        const double before =
            count > 0 ? (step - STEP_SIZE(d->count))[at + PIECES] : d->told[2 * d->count + j];
        if (before != step[at])
            level = 0.0;
    }
    memcpy(last, u, (size_t)s->held * sizeof *u);
    step[0] = t;
    step[1] = level;
    history[DISTURBED] = 0.0;
    history[COUNT] = count + 1;
    history[END] = end;
}

#define FOUND look_back(s, t, x, u, p)
#define PLAIN s->delays->plain
#define LATE(function)                                  \
    static void late_##function(GIVEN, double *result)  \
    {                                                   \
        FOUND;                                          \
        PLAIN.function(s, t, x, u, p, result);          \
    }

LATE(rhs)
LATE(out)
LATE(sample)
LATE(indicate)
LATE(delayed)

static void late_jac(GIVEN, double *J, double *ft)
{
    FOUND;
    PLAIN.jac(s, t, x, u, p, J, ft);
}

static void late_react(const System *s, double t, double *x, double *u, const double *p, int k)
{
    FOUND;
    PLAIN.react(s, t, x, u, p, k);
    s->delays->history[DISTURBED] = 1.0;
}

/* Put delayed signals into the equations of s. */
static void lay_delays(System *s, Delays *delays, int count, int first, double *memory)
{
    delays->count = count;
    delays->first = first;
    delays->plain = *s;
    delays->told = memory;
    delays->node = memory + 4 * count;
    s->delays = delays;
    s->rhs = late_rhs;
    s->jac = late_jac;
    s->out = late_out;
    s->sample = late_sample;
    s->indicate = late_indicate;
    s->react = late_react;
    s->delayed = late_delayed;
}
