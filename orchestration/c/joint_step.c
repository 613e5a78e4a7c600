/* One corrected step of a plant and a controller that carry tangents, see tangents_over_fmus.py.
 *
 * A law and its tangents are rows of m commands, m x n gains and m rates: row 0 the law, row k its
 * k-th tangent. Signals and their tangents are rows of n. */
#include "../../solver/c/orthonormalize.h"

/* An FMU with tangents.
 *
 * Inputs of a plant: laws with the signals they refer to, then their tangents; of a controller:
 * signals, set-points, tangents of the signals. Outputs: of a plant signals, of a controller its law;
 * then their tangents. */
typedef struct {
    Calls calls;
    Calls frames; /* inputs: none; outputs: the states' tangents, count x states */
    int64_t states;
} Side;

/* A controller that is asked by somebody else, where it has no tangents of its own. */
typedef struct {
    int (*law)(double t, double h, const double *signals, double *law);
    int (*advance)(double t, double h, const double *signals);
    int (*tangents)(double *rows);
    int (*restored)(void); /* its FMU is back at the step's start */
} Asked;

typedef struct {
    Side plant, controller;
    Asked asked; /* null where the controller has tangents */
    int64_t m, n, count;
    Vector reference;           /* set-points */
    Vector start, end, middle;  /* rows x n */
    Vector law, mended, ramped; /* rows x m (2 + n) */
    Vector applied;             /* rows x m: commands at the end of the step */
    /* orthonormal joint tangents, count x states, and the logarithms of the lengths they had, without
     * and with the correction */
    Vector plain, plain_logs, frame, logs;
} Joint;

static int read_rows(Calls *c, double *rows)
{
    TRY(take(c, c->taken.size));
    copy(c->taken.at, rows, c->taken.size);
    return 1;
}

/* Apply a law over a part of the step; it refers to the signals at the step's start. */
static int step_with_law(Joint *j, double t, double h, const double *law)
{
    const int64_t m = j->m, n = j->n, width = m * (2 + n);
    double *given = j->plant.calls.given.at;
    for (int64_t row = 0; row <= j->count; row++) {
        const double *const own = law + row * width, *const signals = j->start.at + row * n;
        copy(own, given, m + m * n);
        given += m + m * n;
        for (int64_t k = 0; k < m; k++, given += n)
            copy(signals, given, n);
        copy(own + m + m * n, given, m);
        given += m;
    }
    TRY(put(&j->plant.calls, j->plant.calls.given.size));
    return move(&j->plant.calls, t, h);
}

/* Give the controller signals and their tangents. */
static int set_signals(Joint *j, const double *signals)
{
    Calls *const c = &j->controller.calls;
    const int64_t n = j->n, width = j->reference.size;
    copy(signals, c->given.at, n);
    copy(j->reference.at, c->given.at + n, width);
    copy(signals + n, c->given.at + n + width, j->count * n);
    return put(c, c->given.size);
}

static int law_of(Joint *j, double t, double h, const double *signals, double *law)
{
    if (j->asked.law)
        return j->asked.law(t, h, signals, law);
    return set_signals(j, signals) && read_rows(&j->controller.calls, law);
}

static int advance_controller(Joint *j, double t, double h, const double *signals)
{
    if (j->asked.advance)
        return j->asked.advance(t, h, signals);
    return set_signals(j, signals) && move(&j->controller.calls, t, h);
}

/* Both sides' tangents as joint rows, orthonormalized. */
static int joint_frame(Joint *j, double *frame, double *logs)
{
    const int64_t p = j->plant.states, c = j->controller.states;
    double *const theirs = j->controller.frames.taken.at;
    TRY(take(&j->plant.frames, j->plant.frames.taken.size));
    TRY(j->asked.tangents ? j->asked.tangents(theirs)
                          : take(&j->controller.frames, j->controller.frames.taken.size));
    for (int64_t k = 0; k < j->count; k++) {
        copy(j->plant.frames.taken.at + k * p, frame + k * (p + c), p);
        copy(theirs + k * c, frame + k * (p + c) + p, c);
        logs[k] = 0.0;
    }
    orthonormalize(frame, (int)j->count, (int)(p + c), logs);
    return 1;
}

/* Commands and their tangents as the plant has applied them at the end of the step. */
static void find_applied(Joint *j, double h)
{
    const int64_t m = j->m, n = j->n, width = m * (2 + n);
    for (int64_t row = 0; row <= j->count; row++) {
        const double *const own = j->law.at + row * width;
        for (int64_t k = 0; k < m; k++) {
            double command = own[k] + own[m + m * n + k] * h;
            for (int64_t i = 0; i < n; i++) {
                const double change = j->end.at[row * n + i] - j->start.at[row * n + i];
                command += j->law.at[m + k * n + i] * change;
                if (row > 0)
                    command += own[m + k * n + i] * (j->end.at[i] - j->start.at[i]);
            }
            j->applied.at[row * m + k] = command;
        }
    }
}

/* The law that makes up for part of what its commands miss at the end of the step. */
static void find_mended(Joint *j, double h)
{
    const int64_t m = j->m, rate = m + m * j->n, width = m * (2 + j->n);
    copy(j->law.at, j->mended.at, (1 + j->count) * width);
    for (int64_t row = 0; row <= j->count; row++) {
        for (int64_t k = 0; k < m; k++) {
            const double missed = j->ramped.at[row * width + k] - j->applied.at[row * m + k];
            j->mended.at[row * width + rate + k] += RAMP_SHARE * missed / h;
        }
    }
}

static int restore_sides(Joint *j)
{
    TRY(restore(&j->plant.calls, CORRECTION));
    TRY(restore(&j->controller.calls, CORRECTION));
    return !j->asked.restored || j->asked.restored();
}

/* One corrected step, much as `step` does it, of signals and tangents alike, from the states saved at
 * `joint_start`; leaves the frames without and with the correction. */
API int joint_step(Joint *j, double t, double h)
{
    const int64_t m = j->m, rate = m + m * j->n, width = m * (2 + j->n), rows = 1 + j->count;
    const int64_t signals = rows * j->n;
    TRY(law_of(j, t, h, j->start.at, j->law.at));
    TRY(step_with_law(j, t, h, j->law.at));
    TRY(read_rows(&j->plant.calls, j->end.at));
    for (int64_t k = 0; k < signals; k++)
        j->middle.at[k] = 0.5 * (j->start.at[k] + j->end.at[k]);
    TRY(advance_controller(j, t, h, j->middle.at));
    TRY(joint_frame(j, j->plain.at, j->plain_logs.at));
    TRY(law_of(j, t + h, h, j->end.at, j->ramped.at)); /* the true commands */
    find_applied(j, h);
    find_mended(j, h);
    TRY(restore_sides(j));
    TRY(step_with_law(j, t, 0.5 * h, j->mended.at));
    TRY(read_rows(&j->plant.calls, j->middle.at));
    copy(j->mended.at, j->ramped.at, rows * width);
    for (int64_t row = 0; row < rows; row++) {
        for (int64_t k = 0; k < m; k++)
            j->ramped.at[row * width + k] += j->mended.at[row * width + rate + k] * 0.5 * h;
    }
    TRY(step_with_law(j, t + 0.5 * h, 0.5 * h, j->ramped.at));
    TRY(read_rows(&j->plant.calls, j->end.at));
    /* Simpson's mean for the controller's states, where the first pass took the trapezoid's: the
     * difference shows what neither can see of signals that move fast within the step. */
    for (int64_t k = 0; k < signals; k++)
        j->middle.at[k] = (j->start.at[k] + 4.0 * j->middle.at[k] + j->end.at[k]) / 6.0;
    TRY(advance_controller(j, t, h, j->middle.at));
    return joint_frame(j, j->frame.at, j->logs.at);
}

/* The signals and tangents where a step begins, with the states to come back to. */
API int joint_start(Joint *j)
{
    TRY(read_rows(&j->plant.calls, j->start.at));
    return save(&j->plant.calls, CORRECTION) && save(&j->controller.calls, CORRECTION);
}

API int joint_restore(Joint *j) { return restore_sides(j); }

API void joint_release(Joint *j)
{
    release(&j->plant.calls, CORRECTION);
    release(&j->controller.calls, CORRECTION);
}
