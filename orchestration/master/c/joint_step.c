/* Corrected steps of a plant and a controller that carry tangents, see tangents_over_fmus.py.
 * A law and its tangents are rows of m commands, m x n gains and m rates: row 0 the law, row k its
 * k-th tangent. Signals and their tangents are rows of n. */
#include "../../../solver/c/orthonormalize.h"

#define LEAST_SHARE 1e-3 /* of the total allowed error, which any one step may have */

/* An FMU with tangents. Inputs of a plant: laws with the signals they refer to, then their tangents;
 * of a controller: signals, set-points, tangents of the signals. Outputs: of a plant signals, of a
 * controller its law; then their tangents. */
typedef struct {
    Calls calls;
    /* inputs: the states' tangents, count x states, and the number of the frame; outputs: these
     * tangents, and the integral of the trace */
    Calls frames;
    int64_t states;
} Side;

typedef struct {
    Side plant, controller;
    Calls shown; /* outputs: the recorded outputs of the plant */
    int64_t m, n, count;
    Vector reference;           /* set-points */
    Vector start, end, middle;  /* rows x n */
    Vector law, mended, ramped; /* rows x m (2 + n) */
    /* orthonormal joint tangents, count x states, and the logarithms of their lengths before,
     * without and with the correction */
    Vector plain, plain_logs, frame, logs;
} Joint;

/* The record of the run, and the allowed errors of its steps. */
typedef struct {
    Vector times, outputs, growth, trace; /* row by row; row 0 is the last one before */
    int64_t rows;
    Vector bound;              /* outputs beyond which the loop diverges */
    double accuracy, relative; /* largest change by all corrections: nats, share of the growth */
    int64_t unmet;             /* number of shortest steps with a larger change */
} Trail;

/* Apply a law over a part of the step, and read the signals; it refers to those at the start. */
static int step_with_law(Joint *j, double t, double h, const double *law, double *signals)
{
    const int64_t m = j->m, n = j->n, width = m * (2 + n);
    double *given = j->plant.calls.given.at;
    for (int64_t row = 0; row <= j->count; row++)
        given = write_law(law + row * width, j->start.at + row * n, given, m, n);
    return put(&j->plant.calls) && move(&j->plant.calls, t, h) && take_all(&j->plant.calls, signals);
}

/* Set the controller's signals and their tangents. */
static int set_signals(Joint *j, const double *signals)
{
    Calls *const c = &j->controller.calls;
    const int64_t n = j->n, width = j->reference.size;
    copy(signals, c->given.at, n);
    copy(j->reference.at, c->given.at + n, width);
    copy(signals + n, c->given.at + n + width, j->count * n);
    return put(c);
}

/* Set one side's tangents to their columns of the joint rows, which begin at `first`. */
static int set_tangents(Joint *j, Side *side, int64_t first)
{
    const int64_t own = side->states, all = j->plant.states + j->controller.states;
    Calls *const c = &side->frames;
    for (int64_t k = 0; k < j->count; k++)
        copy(j->frame.at + k * all + first, c->given.at + k * own, own);
    if (own > 0)
        c->given.at[j->count * own] += 1.0; /* a new frame */
    return put(c);
}

/* Both sides' tangents as joint rows, orthonormalized. */
static int joint_frame(Joint *j, double *frame, double *logs)
{
    const int64_t p = j->plant.states, c = j->controller.states;
    const Vector *const plant = &j->plant.frames.taken, *const controller = &j->controller.frames.taken;
    TRY(take(&j->plant.frames, plant->size) && take(&j->controller.frames, controller->size));
    for (int64_t k = 0; k < j->count; k++) {
        copy(plant->at + k * p, frame + k * (p + c), p);
        copy(controller->at + k * c, frame + k * (p + c) + p, c);
        logs[k] = 0.0;
    }
    orthonormalize(frame, (int)j->count, (int)(p + c), logs);
    return 1;
}

/* Put the law into `mended`, corrected by a part of the error of its commands at the end of the step:
 * the difference of the true ones from those, with their tangents, that the plant has applied. */
static void find_mended(Joint *j, double h)
{
    const int64_t m = j->m, n = j->n, rate = m + m * n, width = m * (2 + n);
    copy(j->law.at, j->mended.at, (1 + j->count) * width);
    for (int64_t row = 0; row <= j->count; row++) {
        const double *const own = j->law.at + row * width;
        const double *const start = j->start.at + row * n, *const end = j->end.at + row * n;
        for (int64_t k = 0; k < m; k++) {
            double applied = own[k] + own[rate + k] * h;
            for (int64_t i = 0; i < n; i++) {
                applied += j->law.at[m + k * n + i] * (end[i] - start[i]);
                if (row > 0)
                    applied += own[m + k * n + i] * (j->end.at[i] - j->start.at[i]);
            }
            const double missed = j->ramped.at[row * width + k] - applied;
            j->mended.at[row * width + rate + k] += RAMP_SHARE * missed / h;
        }
    }
}

/* One corrected step from the states saved before; frames without and with the correction. */
static int joint_step(Joint *j, double t, double h)
{
    const int64_t m = j->m, rate = m + m * j->n, width = m * (2 + j->n), rows = 1 + j->count;
    const int64_t signals = rows * j->n;
    TRY(set_signals(j, j->start.at) && take_all(&j->controller.calls, j->law.at));
    TRY(step_with_law(j, t, h, j->law.at, j->end.at));
    for (int64_t k = 0; k < signals; k++)
        j->middle.at[k] = 0.5 * (j->start.at[k] + j->end.at[k]);
    TRY(set_signals(j, j->middle.at) && move(&j->controller.calls, t, h));
    TRY(joint_frame(j, j->plain.at, j->plain_logs.at));
    TRY(set_signals(j, j->end.at) && take_all(&j->controller.calls, j->ramped.at)); /* true commands */
    find_mended(j, h);
    TRY(restore_both(&j->plant.calls, &j->controller.calls, CORRECTION));
    TRY(step_with_law(j, t, 0.5 * h, j->mended.at, j->middle.at));
    copy(j->mended.at, j->ramped.at, rows * width);
    for (int64_t row = 0; row < rows; row++) {
        for (int64_t k = 0; k < m; k++)
            j->ramped.at[row * width + k] += j->mended.at[row * width + rate + k] * 0.5 * h;
    }
    TRY(step_with_law(j, t + 0.5 * h, 0.5 * h, j->ramped.at, j->end.at));
    /* Simpson's mean for the controller's states; the first pass used the trapezoidal mean. Their
     * difference shows the error of both for signals that move fast within the step. */
    for (int64_t k = 0; k < signals; k++)
        j->middle.at[k] = (j->start.at[k] + 4.0 * j->middle.at[k] + j->end.at[k]) / 6.0;
    TRY(set_signals(j, j->middle.at) && move(&j->controller.calls, t, h));
    return joint_frame(j, j->frame.at, j->logs.at);
}

/* The larger number; NaN if one of them is NaN. */
static double larger_or_nan(double a, double b) { return a > b || a != a ? a : b; }

/* Change of the tangents by the correction of a step, as a share of the allowed change: some nats,
 * or radians of a tangent's direction, plus a share of the growth of that tangent in this step, or
 * of its mean growth if larger. These growths are large for the fast tangents only. */
static double moved_share(const Joint *j, const Clock *clock, const Trail *trail)
{
    const int64_t width = j->plant.states + j->controller.states;
    const double t = clock_now(clock), h = clock_step_to_come(clock), part = t > 0.0 ? h / t : 0.0;
    const double allowed = trail->accuracy * larger(h / clock->stop, LEAST_SHARE);
    const double *const growth = trail->growth.at + trail->rows * j->count;
    double worst = -HUGE_VAL;
    for (int64_t k = 0; k < j->count; k++) {
        double moved = fabs(j->logs.at[k] - j->plain_logs.at[k]);
        for (int64_t i = k * width; i < (k + 1) * width; i++)
            moved = larger_or_nan(moved, fabs(j->frame.at[i] - j->plain.at[i]));
        const double grown = larger_or_nan(fabs(j->logs.at[k]), fabs(growth[k]) * part);
        worst = larger_or_nan(worst, moved / (allowed + trail->relative * grown));
    }
    return worst;
}

/* Halve or double the step, which stays aligned; `share` is its error over the allowed one. */
static void clock_adapt(Clock *c, double share)
{
    if (share > 1.0 && c->stride > 1)
        c->stride /= 2;
    else if (share < 0.1 && c->stride < c->longest && c->count % (2 * c->stride) == 0)
        c->stride *= 2;
}

/* The integral of the trace of one side's Jacobian. */
static double trace_of(const Side *s, int64_t count)
{
    return s->states > 0 ? s->frames.taken.at[count * s->states] : 0.0;
}

/* Do one step, halved until its correction is small, and record its row; 0 if a call failed. */
static int joint_row(Joint *j, Clock *clock, Trail *trail)
{
    const int64_t count = j->count, outputs = j->shown.taken.size;
    double share;
    TRY(set_tangents(j, &j->plant, 0) && set_tangents(j, &j->controller, j->plant.states));
    TRY(take_all(&j->plant.calls, j->start.at));
    TRY(save_both(&j->plant.calls, &j->controller.calls, CORRECTION));
    for (;;) {
        TRY(joint_step(j, clock_now(clock), clock_step_to_come(clock)));
        share = moved_share(j, clock, trail);
        if (!(share > 1.0) || clock->stride <= 1)
            break;
        TRY(restore_both(&j->plant.calls, &j->controller.calls, CORRECTION));
        clock_adapt(clock, share);
    }
    TRY(take(&j->shown, outputs));
    trail->unmet += !(share <= 1.0) && trail->accuracy < HUGE_VAL;
    clock_accept(clock);
    clock_adapt(clock, share);
    const int64_t row = ++trail->rows;
    double *const growth = trail->growth.at + row * count;
    trail->times.at[row] = clock_now(clock);
    copy(j->shown.taken.at, trail->outputs.at + row * outputs, outputs);
    for (int64_t k = 0; k < count; k++)
        growth[k] = growth[k - count] + j->logs.at[k];
    trail->trace.at[row] = trace_of(&j->plant, count) + trace_of(&j->controller, count);
    return 1;
}

/* Do up to `most` steps, recorded from row 1 on; return GOES_ON, or why the run ended. */
API int joint_march(Joint *j, Clock *clock, Trail *trail, int64_t most)
{
    trail->rows = 0;
    while (!clock_done(clock) && trail->rows < most) {
        const int done = joint_row(j, clock, trail);
        release_both(&j->plant.calls, &j->controller.calls, CORRECTION);
        if (!done)
            return STEP_FAILED;
        if (!within(j->shown.taken.at, &trail->bound))
            return DIVERGES;
    }
    return GOES_ON;
}
