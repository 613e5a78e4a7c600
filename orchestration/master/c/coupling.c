/* One communication step of a plant and a controller; see coupling.py for the couplings. */
#include "../../../solver/c/factorize.h"
#include "controller.c"

#define RAMP_SHARE (2.0 / 3.0)
#define HOLD_SHARE 0.5
#define AGREE 1e-12 /* tolerance of an algebraic loop, as a share of a signal */
#define MOST_ITERATIONS 20

/* A plant and a controller that move together, and their record; made by `coupling.CoupledPair`.
 * The plant's inputs: m commands, then gains, references, rates if it takes a law; outputs: all. */
typedef struct {
    Calls plant;
    Controller controller;
    Places signals;           /* which outputs the controller measures */
    Vector commands;          /* nominal values of the plant's commands */
    int64_t takes_law, corrected, averaged;
    int64_t follows;          /* whether outputs may follow inputs without a step */
    int64_t delayed, tangent; /* whether commands come one step late; whether a law is used */
    int (*own)(double h);     /* changes the law that the plant applies; 0: done; may be NULL */
    /* passed on: outputs, last commands, and the law with which the next step begins */
    Vector outputs, late, following;
    double following_step; /* length of the step that the law was found with [s]; NaN: none */
    /* results of the last step: final coupling residual; change of each output by the correction;
     * contraction: small if correcting converges fast, 1 or more if the step is too long for it,
     * NaN if nothing was corrected */
    Vector residual, effect;
    double contraction;
    /* room for one step; for an algebraic loop m (m + 2) */
    Vector start, end, mean, goal, law, applied, reached, command, first, ring;
    /* outputs of the plant and others of the controller at the end of each step */
    Vector recorded;
    int64_t rows;
    double failed, until; /* time of the step in which a co-run failed, else NaN; end of a step [s] */
    int64_t unsolved; /* communication points at which an algebraic loop found no solution */
} Loop;

static void signals_of(const Loop *l, const double *outputs, double *signals)
{
    for (int64_t k = 0; k < l->signals.size; k++)
        signals[k] = outputs[l->signals.at[k]];
}

/* Write a law in the order of a plant's ports, with the signals that it refers to; return its end. */
static double *write_law(const double *law, const double *signals, double *given, int64_t m, int64_t n)
{
    copy(law, given, m + m * n);
    given += m + m * n;
    for (int64_t k = 0; k < m; k++, given += n)
        copy(signals, given, n);
    copy(law + m + m * n, given, m);
    return given + m;
}

/* Set the law in the plant, or only the command if the plant takes no law. */
static int give_law(Loop *l, const double *law, const double *signals)
{
    if (l->takes_law)
        write_law(law, signals, l->plant.given.at, l->controller.m, l->controller.n);
    else
        copy(law, l->plant.given.at, l->controller.m);
    return put(&l->plant);
}

/* By how much the controller's commands miss those of the next step, at the outputs of these. */
static int miss(Loop *l, const double *reference, double *missed)
{
    TRY(give_law(l, l->following.at, l->end.at) && take_all(&l->plant, l->reached.at));
    signals_of(l, l->reached.at, l->end.at);
    TRY(master_command_at(&l->controller, l->end.at, reference, missed));
    for (int64_t k = 0; k < l->controller.m; k++)
        missed[k] -= l->following.at[k];
    return 1;
}

/* Whether commands missed by no more than this share of them. */
static int agrees(const Loop *l, const double *missed, double share)
{
    const double *const law = l->following.at, *const nominal = l->commands.at;
    int found = 1;
    for (int64_t k = 0; k < l->controller.m; k++)
        found = found && fabs(missed[k]) <= share * fmax(fabs(law[k]), nominal[k]);
    return found;
}

/* Solve an algebraic loop, by Newton's method with differences: commands that `miss` nothing. */
static int solve_ring(Loop *l, const double *reference)
{
    const int64_t m = l->controller.m;
    double *const missed = l->ring.at, *const moved = missed + m, *const slopes = moved + m;
    double *const law = l->following.at;
    int32_t pivots[m];
    TRY(miss(l, reference, missed));
    for (int left = MOST_ITERATIONS; left > 0 && !agrees(l, missed, AGREE); left--) {
        for (int64_t j = 0; j < m; j++) {
            const double before = law[j];
            law[j] += 1e-6 * fmax(fabs(before), l->commands.at[j]);
            TRY(miss(l, reference, moved));
            for (int64_t k = 0; k < m; k++)
                slopes[k * m + j] = (moved[k] - missed[k]) / (law[j] - before);
            law[j] = before;
        }
        if (!factorize(slopes, pivots, (int)m))
            break;
        solve_factorized(slopes, pivots, (int)m, missed);
        for (int64_t k = 0; k < m; k++)
            law[k] -= missed[k];
        TRY(miss(l, reference, missed));
    }
    l->unsolved += !agrees(l, missed, sqrt(AGREE));
    return 1;
}

/* Update reached outputs with direct feedthrough to the command of the same instant, and the signals
 * and the next law of a controller that has direct feedthrough, too. */
static int settle(Loop *l, double t, double h, const double *reference)
{
    Controller *const c = &l->controller;
    const double *const signals = l->end.at;
    int changed = 0;
    if (!l->follows)
        return 1;
    TRY(give_law(l, l->following.at, signals) && take_all(&l->plant, l->reached.at));
    for (int64_t k = 0; k < l->signals.size; k++) {
        const double now = l->reached.at[l->signals.at[k]];
        changed = changed || fabs(now - signals[k]) > AGREE * fmax(fabs(now), c->nominal.at[k]);
    }
    return !changed ||
           (solve_ring(l, reference) &&
            master_law_at(c, t, h, signals, reference, (int)l->tangent, l->following.at));
}

/* Find the law at the present signals: it is known from the end of the last step, except at a start,
 * after a jump, and for a step of another length of a controller that answers in its step. */
static int law_now(Loop *l, double t, double h, const double *reference, int probe)
{
    Controller *const c = &l->controller;
    signals_of(l, l->outputs.at, l->start.at);
    if (c->m && (isnan(l->following_step) || (c->answer != DIRECT && l->following_step != h)))
        return master_law_at(c, t, h, l->start.at, reference, probe, l->law.at);
    copy(l->following.at, l->law.at, l->law.size);
    return 1;
}

/* The controller's true commands at the present signals. With `last`, no step beyond t is tried: a
 * controller that answers in its step then gives the command at the end of its last step. */
API int master_command_now(Loop *l, double t, double h, const double *reference, int last,
                           double *commands)
{
    if (last && l->controller.answer != DIRECT)
        return master_read_commands(&l->controller, commands);
    TRY(law_now(l, t, h, reference, 0));
    copy(l->law.at, commands, l->controller.m);
    return 1;
}

/* Update a row's outputs with direct feedthrough to the command of a controller without direct
 * feedthrough; with other controllers, `settle` has done this within the step. */
static int settle_row(Loop *l, double t, double h, const double *reference, int last)
{
    if (!l->follows || l->controller.answer == DIRECT)
        return 1;
    TRY(master_command_now(l, t, h, reference, last, l->command.at));
    memset(l->law.at, 0, (size_t)l->law.size * sizeof *l->law.at);
    copy(l->command.at, l->law.at, l->controller.m);
    return give_law(l, l->law.at, l->start.at) && take_all(&l->plant, l->outputs.at);
}

/* The law at the start of a step; its rates include the change of the set-points. */
static int law_of_step(Loop *l, double t, double h, const double *before, const double *after)
{
    Controller *const c = &l->controller;
    double *const law = l->law.at, *const rate = law + c->m * (1 + c->n), *const moved = l->command.at;
    TRY(law_now(l, t, h, before, (int)l->tangent));
    if (!l->tangent || c->answer != DIRECT || !differ(before, after, l->goal.size))
        return 1;
    TRY(master_command_at(c, l->start.at, after, moved));
    for (int64_t k = 0; k < c->m; k++)
        rate[k] += (moved[k] - law[k]) / h;
    return 1;
}

/* Find the true command at the end of a step, in which a controller that answers in it has moved. */
static int command_after(Loop *l, double h, const double *after)
{
    Controller *const c = &l->controller;
    copy(l->late.at, l->command.at, c->m);
    if (c->answer != STEPPED || !c->saves || !c->m)
        return 1;
    TRY(master_law_at(c, l->until, h, l->end.at, after, 0, l->following.at));
    copy(l->following.at, l->command.at, c->m);
    if (!l->tangent) /* the next step begins with it, so that it is not probed again */
        l->following_step = h;
    return 1;
}

/* Move the plant, then the controller if it answers at once; find the reached outputs and the true
 * command at the end. */
static int move_both(Loop *l, double t, double h, const double *before, const double *after)
{
    Controller *const c = &l->controller;
    double *const start = l->start.at, *const end = l->end.at;
    const double *signals = l->delayed ? start : end, *goal = l->delayed ? before : after;
    TRY(give_law(l, l->applied.at, start));
    TRY(move(&l->plant, t, h) && take_all(&l->plant, l->reached.at));
    signals_of(l, l->reached.at, end);
    if (c->answer != DIRECT)
        return command_after(l, h, after);
    if (l->averaged) {
        for (int64_t k = 0; k < l->end.size; k++)
            l->mean.at[k] = c->real.at[k] ? 0.5 * (start[k] + end[k]) : end[k];
        for (int64_t k = 0; k < l->goal.size; k++)
            l->goal.at[k] = c->real.at[c->n + k] ? 0.5 * (before[k] + after[k]) : after[k];
        signals = l->mean.at, goal = l->goal.at;
    }
    TRY(master_advance(c, t, h, signals, goal));
    if (l->delayed) /* the next command has not seen the end of this step, however it is averaged */
        TRY(master_command_at(c, start, before, l->late.at));
    TRY(master_law_at(c, t + h, h, end, after, (int)l->tangent, l->following.at));
    TRY(settle(l, t + h, h, after));
    l->following_step = h;
    copy(l->following.at, l->command.at, c->m);
    return 1;
}

/* True minus applied command at the end of the step; without correction at the start, if larger. */
static void find_residual(const Loop *l, double h, double *residual)
{
    const int64_t m = l->controller.m, n = l->controller.n;
    const double *const applied = l->applied.at;
    for (int64_t k = 0; k < m; k++) {
        double given = applied[k], change = 0.0;
        for (int64_t j = 0; j < n && l->takes_law; j++)
            change += applied[m + k * n + j] * (l->end.at[j] - l->start.at[j]);
        if (l->takes_law)
            given = given + change + applied[m * (1 + n) + k] * h;
        residual[k] = l->command.at[k] - given;
        const double at_start = l->law.at[k] - applied[k];
        if (!l->corrected && fabs(at_start) > fabs(residual[k]))
            residual[k] = at_start;
    }
}

/* Correct the law by a part of the residual. The residual grows with the square of the time within
 * the step, the correcting ramp with the time: two thirds of it give the plant the right impulse
 * over the step. A plant that takes no ramp gets half of the residual. */
static void mend(Loop *l, double h)
{
    const int64_t m = l->controller.m;
    double *const law = l->applied.at, *const rate = law + m * (1 + l->controller.n);
    for (int64_t k = 0; k < m; k++) {
        if (l->takes_law)
            rate[k] += RAMP_SHARE * l->first.at[k] / h;
        else
            law[k] += HOLD_SHARE * l->first.at[k];
    }
}

/* Size of the controller's answer to a correction, as a share of the correction. */
static double contraction_of(const Loop *l)
{
    const double share = l->takes_law ? RAMP_SHARE : HOLD_SHARE;
    double size = 0.0, rest = 0.0;
    for (int64_t k = 0; k < l->controller.m; k++) {
        const double first = l->first.at[k], left = l->residual.at[k] - (1 - share) * first;
        size += first * first;
        rest += left * left;
    }
    return size > 0 ? sqrt(rest) / (share * sqrt(size)) : 0.0;
}

/* Move from t to t + h while the set-points go from `before` to `after`. */
static int step(Loop *l, double t, double h, const double *before, const double *after)
{
    Calls *const plant = &l->plant, *const controller = &l->controller.calls;
    const int64_t count = l->outputs.size, m = l->controller.m;
    TRY(law_of_step(l, t, h, before, after));
    copy(l->law.at, l->applied.at, l->law.size);
    if (l->delayed && !(m > 0 && isnan(l->late.at[0]))) /* NaN: not late at the start */
        copy(l->late.at, l->applied.at, m);
    if (l->own)
        TRY(l->own(h) == 0);
    if (l->controller.answer != DIRECT) /* its step has the signals at the start, corrected or not */
        TRY(master_advance(&l->controller, t, h, l->start.at, before) &&
            master_read_commands(&l->controller, l->late.at));
    if (l->corrected) {
        TRY(save_both(plant, controller, CORRECTION) && move_both(l, t, h, before, after));
        find_residual(l, h, l->first.at);
        copy(l->reached.at, l->effect.at, count);
        mend(l, h);
        TRY(restore_both(plant, controller, CORRECTION));
    }
    TRY(move_both(l, t, h, before, after));
    find_residual(l, h, l->residual.at);
    copy(l->reached.at, l->outputs.at, count);
    if (l->corrected) {
        release_both(plant, controller, CORRECTION);
        for (int64_t k = 0; k < count; k++)
            l->effect.at[k] = fabs(l->outputs.at[k] - l->effect.at[k]);
        l->contraction = contraction_of(l);
    }
    return 1;
}

/* The controller's commands after the plant has moved with the given ones, for a time from zero. */
API int master_answer_to(Loop *l, const double *given, double h, const double *reference,
                         double *commands)
{
    copy(given, l->law.at, l->controller.m);
    TRY(give_law(l, l->law.at, l->start.at) && move(&l->plant, 0.0, h));
    TRY(take_all(&l->plant, l->reached.at));
    signals_of(l, l->reached.at, l->end.at);
    return master_command_at(&l->controller, l->end.at, reference, commands);
}
