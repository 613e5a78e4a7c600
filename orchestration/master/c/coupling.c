/* One communication step of a plant and a controller.
 *
 * See coupling.py for the couplings. A *law* is one array here, in the order of the ports that it
 * is read from: m commands, their derivatives by n signals each, their own rates. */
#include "calls.h"

#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

enum { DIRECT, STEPPED, SAMPLED };
enum { CHECKPOINT, CORRECTION, PROBE }; /* uses of saved states */

#define RAMP_SHARE (2.0 / 3.0)
#define HOLD_SHARE 0.5
#define PROBE_PARTS 64
#define AGREE 1e-12      /* tolerance of an algebraic loop, as a share of a signal */
#define MOST_ITERATIONS 20

/* A controller as a function: commands for given signals.
 *
 * Inputs: n signals, references; outputs: m commands, then gains and rates if it reports a law, and
 * others that are only recorded. A group gets the present signals before the others are read. */
typedef struct {
    Calls calls;
    int64_t m, n, others, group, answer, reports, saves, varies;
    Vector nominal;    /* of the signals */
    Vector real;       /* whether each signal and reference is Real */
    Vector ahead;      /* commands after a step that cannot be taken back */
    int64_t is_ahead;  /* whether it has done such a step */
    Vector moved;      /* room for n signals */
    Vector answered;   /* room for m commands */
} Controller;

/* A plant and a controller that move together; made by `coupling.CoupledPair`.
 *
 * The plant's inputs: m commands, then gains, references, rates if it takes a law; outputs: all. */
typedef struct {
    Calls plant;
    int64_t takes_law;
    int64_t follows; /* whether outputs may follow inputs without a step */
    int64_t unsolved; /* communication points at which an algebraic loop found no solution */
    Places signals; /* which outputs the controller measures */
    Controller controller;
    int64_t delayed, tangent;  /* whether commands come one step late; whether a law is used */
    int (*own)(double h);      /* changes the law that the plant applies; may be NULL */
    int64_t corrected, averaged;
    /* passed from step to step: outputs, last commands, and the law at the end of the last step,
     * with which the next step begins */
    Vector outputs, late, following;
    int64_t has_following;
    double following_step; /* length of the step that the law was found with, if it matters [s] */
    /* the same, saved by `keep` */
    Vector kept_outputs, kept_late, kept_following;
    int64_t kept_has_following;
    /* results of the last step: final coupling residual; change of each output by the correction;
     * contraction: small if correcting converges fast, 1 or more if the step is too long for it,
     * NaN if nothing was corrected */
    Vector residual, effect;
    double contraction;
    /* room for one step */
    Vector start, end, mean, goal, law, applied, stepped, reached, command, first;
    Vector ring;     /* m (m + 2): for an algebraic loop */
    Vector commands; /* nominal values of the plant's commands */
} Loop;

API int master_set_inputs(Controller *c, const double *signals, const double *reference)
{
    copy(signals, c->calls.given.at, c->n);
    copy(reference, c->calls.given.at + c->n, c->calls.given.size - c->n);
    return put(&c->calls, c->calls.given.size);
}

/* The present commands. */
API int master_read_commands(Controller *c, double *commands)
{
    TRY(take(&c->calls, c->m));
    copy(c->calls.taken.at, commands, c->m);
    return 1;
}

API int master_command_at(Controller *c, const double *signals, const double *reference,
                          double *commands)
{
    return master_set_inputs(c, signals, reference) && master_read_commands(c, commands);
}

/* The commands at these signals, at once or after a step from the state saved for probing. */
static int answer_at(Controller *c, double t, double h, const double *signals,
                     const double *reference, double *commands)
{
    TRY(master_set_inputs(c, signals, reference));
    if (c->answer != DIRECT && !at_end(&c->calls, t))
        TRY(move(&c->calls, t, h));
    TRY(master_read_commands(c, commands));
    return c->answer == DIRECT || restore(&c->calls, PROBE);
}

/* Derivatives of the commands by the signals, by differences from the law's commands. */
API int master_probe_gains(Controller *c, double t, double h, const double *signals,
                           const double *reference, double *law)
{
    const int64_t m = c->m, n = c->n;
    double *const moved = c->moved.at, *const commands = c->answered.at;
    copy(signals, moved, n);
    for (int64_t j = 0; j < n; j++) {
        if (!c->real.at[j])
            continue;
        moved[j] += 1e-7 * fmax(fabs(signals[j]), 1e-3 * c->nominal.at[j]);
        TRY(answer_at(c, t, h, moved, reference, commands));
        for (int64_t k = 0; k < m; k++)
            law[m + k * n + j] = (commands[k] - law[k]) / (moved[j] - signals[j]);
        moved[j] = signals[j];
    }
    return 1;
}

static int stepped_law(Controller *c, double t, double h, const double *signals,
                       const double *reference, int probe, double *law)
{
    if (!c->saves) {
        if (!c->is_ahead) {
            TRY(master_set_inputs(c, signals, reference));
            TRY(move(&c->calls, t, h));
            TRY(master_read_commands(c, c->ahead.at));
            c->is_ahead = 1;
        }
        copy(c->ahead.at, law, c->m);
        return 1;
    }
    TRY(save(&c->calls, PROBE));
    TRY(answer_at(c, t, h, signals, reference, law));
    if (probe && c->answer == STEPPED)
        TRY(master_probe_gains(c, t, h, signals, reference, law));
    release(&c->calls, PROBE);
    return 1;
}

/* The rates of the commands with held signals: the slope at the start. The secant would give the
 * right command at the end of the step, and the error in between would not show in the residual. */
static int probe_rates(Controller *c, double t, double h, const double *signals,
                       const double *reference, double *law)
{
    double *const rate = law + c->m * (1 + c->n);
    if (!c->varies || at_end(&c->calls, t))
        return 1;
    TRY(save(&c->calls, PROBE));
    TRY(master_set_inputs(c, signals, reference));
    TRY(move(&c->calls, t, h / PROBE_PARTS));
    TRY(master_command_at(c, signals, reference, rate));
    for (int64_t k = 0; k < c->m; k++)
        rate[k] = (rate[k] - law[k]) * PROBE_PARTS / h;
    TRY(restore(&c->calls, PROBE));
    release(&c->calls, PROBE);
    return 1;
}

/* Put the commands at the given signals, and with `probe` their derivatives, into `law`.
 *
 * The controller's state is not changed, with one exception: a controller that answers in its step
 * and cannot save its state has moved to t + h; `advance` takes this into account. */
API int master_law_at(Controller *c, double t, double h, const double *signals,
                      const double *reference, int probe, double *law)
{
    const int64_t m = c->m, size = m * (2 + c->n);
    if (c->answer == DIRECT && c->reports && probe) {
        TRY(master_set_inputs(c, signals, reference));
        TRY(take(&c->calls, size));
        copy(c->calls.taken.at, law, size);
        return 1;
    }
    memset(law + m, 0, (size_t)(size - m) * sizeof *law);
    if (c->answer != DIRECT)
        return stepped_law(c, t, h, signals, reference, probe, law);
    TRY(master_command_at(c, signals, reference, law));
    if (!probe)
        return 1;
    TRY(master_probe_gains(c, t, h, signals, reference, law));
    if (c->saves)
        TRY(probe_rates(c, t, h, signals, reference, law));
    return master_set_inputs(c, signals, reference);
}

/* Move the controller from t to t + h with these signals held. */
API int master_advance(Controller *c, double t, double h, const double *signals,
                       const double *reference)
{
    if (c->is_ahead) {
        c->is_ahead = 0;
        return 1;
    }
    return master_set_inputs(c, signals, reference) && move(&c->calls, t, h);
}

API int master_read_outputs(Calls *plant, double *outputs)
{
    TRY(take(plant, plant->taken.size));
    copy(plant->taken.at, outputs, plant->taken.size);
    return 1;
}

static void signals_of(const Loop *l, const double *outputs, double *signals)
{
    for (int64_t k = 0; k < l->signals.size; k++)
        signals[k] = outputs[l->signals.at[k]];
}

/* Set the law in the plant, or only the command if the plant takes no law. */
static int give_law(Loop *l, const double *law, const double *signals)
{
    const int64_t m = l->controller.m, n = l->controller.n;
    double *const given = l->plant.given.at;
    copy(law, given, m);
    if (l->takes_law) {
        copy(law + m, given + m, m * n);
        for (int64_t k = 0; k < m; k++)
            copy(signals, given + m + (m + k) * n, n);
        copy(law + m + m * n, given + m + 2 * m * n, m);
    }
    return put(&l->plant, l->plant.given.size);
}

/* Apply the law over a step, or hold the command if the plant takes no law. */
static int step_plant(Loop *l, double t, double h, const double *law, const double *signals,
                      double *outputs)
{
    TRY(give_law(l, law, signals));
    TRY(move(&l->plant, t, h));
    return master_read_outputs(&l->plant, outputs);
}

/* Solve A x = b of m equations by elimination; both are overwritten, b by x. */
static void solve_small(double *a, double *b, int64_t m)
{
    for (int64_t k = 0; k < m; k++) {
        int64_t best = k;
        for (int64_t i = k + 1; i < m; i++)
            best = fabs(a[i * m + k]) > fabs(a[best * m + k]) ? i : best;
        for (int64_t j = 0; j <= m; j++) {
            double *const p = j < m ? &a[k * m + j] : &b[k], *const q = j < m ? &a[best * m + j] : &b[best];
            const double kept = *p;
            *p = *q;
            *q = kept;
        }
        for (int64_t i = 0; i < m; i++) {
            const double factor = i == k ? 0.0 : a[i * m + k] / a[k * m + k];
            for (int64_t j = k; j < m; j++)
                a[i * m + j] -= factor * a[k * m + j];
            b[i] -= factor * b[k];
        }
    }
    for (int64_t k = 0; k < m; k++)
        b[k] /= a[k * m + k];
}

/* Try the commands in `law`: read the outputs that follow from them, and put the difference of the
 * controller's commands at these outputs from the tried ones into `missed`. */
static int miss(Loop *l, const double *reference, const double *law, double *outputs, double *signals,
                double *missed)
{
    TRY(give_law(l, law, signals));
    TRY(master_read_outputs(&l->plant, outputs));
    signals_of(l, outputs, signals);
    TRY(master_command_at(&l->controller, signals, reference, missed));
    for (int64_t k = 0; k < l->controller.m; k++)
        missed[k] -= law[k];
    return 1;
}

/* Solve an algebraic loop: find commands that are equal to the controller's commands at the outputs
 * that follow from them, by Newton's method with differences. */
static int solve_ring(Loop *l, const double *reference, double *law, double *outputs, double *signals)
{
    const int64_t m = l->controller.m;
    double *const missed = l->ring.at, *const moved = missed + m, *const slopes = moved + m;
    TRY(miss(l, reference, law, outputs, signals, missed));
    for (int left = MOST_ITERATIONS; left > 0; left--) {
        int agree = 1;
        for (int64_t k = 0; k < m; k++)
            agree = agree && fabs(missed[k]) <= AGREE * fmax(fabs(law[k]), l->commands.at[k]);
        if (agree)
            return 1;
        for (int64_t j = 0; j < m; j++) {
            const double before = law[j];
            law[j] += 1e-6 * fmax(fabs(before), l->commands.at[j]);
            TRY(miss(l, reference, law, outputs, signals, moved));
            for (int64_t k = 0; k < m; k++)
                slopes[k * m + j] = (moved[k] - missed[k]) / (law[j] - before);
            law[j] = before;
        }
        solve_small(slopes, missed, m);
        for (int64_t k = 0; k < m; k++)
            law[k] -= missed[k];
        TRY(miss(l, reference, law, outputs, signals, missed));
    }
    for (int64_t k = 0; k < m; k++) {
        if (!(fabs(missed[k]) <= sqrt(AGREE) * fmax(fabs(law[k]), l->commands.at[k]))) {
            l->unsolved++;
            return 1;
        }
    }
    return 1;
}

/* Update outputs with direct feedthrough to the command of the same instant; also `law` and
 * `signals` if the controller has direct feedthrough, too. */
static int settle(Loop *l, double t, double h, const double *reference, double *law, double *outputs,
                  double *signals)
{
    Controller *const c = &l->controller;
    if (!l->follows)
        return 1;
    TRY(give_law(l, law, signals));
    TRY(master_read_outputs(&l->plant, outputs));
    int changed = 0;
    for (int64_t k = 0; k < l->signals.size; k++) {
        const double now = outputs[l->signals.at[k]];
        changed = changed || fabs(now - signals[k]) > AGREE * fmax(fabs(now), c->nominal.at[k]);
    }
    if (!changed || c->answer != DIRECT)
        return 1;
    TRY(solve_ring(l, reference, law, outputs, signals));
    return master_law_at(c, t, h, signals, reference, (int)l->tangent, law);
}

/* Whether the law of the next step is known from the end of the last step. */
static int is_known(const Loop *l, double h)
{
    return l->has_following && (l->controller.answer == DIRECT || l->following_step == h);
}

/* The controller's true commands at the present signals. With `last`, no step beyond t is tried: a
 * controller that answers in its step then gives the command at the end of its last step. */
API int master_command_now(Loop *l, double t, double h, const double *reference, int last,
                           double *commands)
{
    Controller *const c = &l->controller;
    if (last && c->answer != DIRECT)
        return master_read_commands(c, commands);
    if (is_known(l, h)) {
        copy(l->following.at, commands, c->m);
        return 1;
    }
    signals_of(l, l->outputs.at, l->start.at);
    TRY(master_law_at(c, t, h, l->start.at, reference, 0, l->law.at));
    copy(l->law.at, commands, c->m);
    return 1;
}

/* Update a row's outputs with direct feedthrough to the command of a controller without direct
 * feedthrough; with other controllers, `settle` has done this within the step. */
static int settle_row(Loop *l, double t, double h, const double *reference, int last)
{
    Controller *const c = &l->controller;
    if (!l->follows || c->answer == DIRECT)
        return 1;
    TRY(master_command_now(l, t, h, reference, last, l->command.at));
    memset(l->law.at, 0, (size_t)l->law.size * sizeof *l->law.at);
    copy(l->command.at, l->law.at, c->m);
    TRY(give_law(l, l->law.at, l->start.at));
    return master_read_outputs(&l->plant, l->outputs.at);
}

/* The law at the start of a step; its rates include the change of the set-points. */
static int law_of_step(Loop *l, double t, double h, const double *before, const double *after)
{
    Controller *const c = &l->controller;
    double *const law = l->law.at;
    const int tangent = (int)l->tangent;
    if (is_known(l, h))
        copy(l->following.at, law, l->law.size);
    else
        TRY(master_law_at(c, t, h, l->start.at, before, tangent, law));
    if (!tangent || c->answer != DIRECT)
        return 1;
    int moves = 0;
    for (int64_t k = 0; k < l->goal.size; k++)
        moves = moves || after[k] != before[k];
    if (moves) {
        double *const moved = l->command.at, *const rate = law + c->m * (1 + c->n);
        TRY(master_command_at(c, l->start.at, after, moved));
        for (int64_t k = 0; k < c->m; k++)
            rate[k] += (moved[k] - law[k]) / h;
    }
    return 1;
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

/* Move the plant, then the controller; find the reached outputs and the true command at the end. */
static int move_both(Loop *l, double t, double h, const double *before, const double *after)
{
    Controller *const c = &l->controller;
    const int is_late = l->delayed && !l->corrected;
    double *const end = l->end.at;
    TRY(step_plant(l, t, h, l->applied.at, l->start.at, l->reached.at));
    signals_of(l, l->reached.at, end);
    if (c->answer != DIRECT) {
        TRY(master_advance(c, t, h, l->start.at, before));
        TRY(master_read_commands(c, l->late.at));
        copy(l->late.at, l->command.at, c->m);
        if (c->answer == STEPPED && c->saves) {
            TRY(master_law_at(c, t + h, h, end, after, 0, l->stepped.at));
            copy(l->stepped.at, l->command.at, c->m);
            if (!l->tangent) { /* the next step begins with it, so that it is not probed again */
                copy(l->stepped.at, l->following.at, l->following.size);
                l->following_step = h;
                l->has_following = 1;
            }
        }
        return 1;
    }
    if (l->averaged) {
        for (int64_t k = 0; k < l->end.size; k++)
            l->mean.at[k] = c->real.at[k] ? 0.5 * (l->start.at[k] + end[k]) : end[k];
        for (int64_t k = 0; k < l->goal.size; k++)
            l->goal.at[k] = c->real.at[c->n + k] ? 0.5 * (before[k] + after[k]) : after[k];
        TRY(master_advance(c, t, h, l->mean.at, l->goal.at));
    } else {
        TRY(master_advance(c, t, h, is_late ? l->start.at : end, is_late ? before : after));
    }
    if (is_late) /* the next command has not seen the end of this step, however it is averaged */
        TRY(master_command_at(c, l->start.at, before, l->late.at));
    TRY(master_law_at(c, t + h, h, end, after, (int)l->tangent, l->following.at));
    TRY(settle(l, t + h, h, after, l->following.at, l->reached.at, end));
    l->has_following = 1;
    copy(l->following.at, l->command.at, c->m);
    return 1;
}

/* True minus applied command at the end of the step; without correction at the start, if larger. */
static void find_residual(const Loop *l, double h, double *residual)
{
    const int64_t m = l->controller.m, n = l->controller.n;
    const double *const applied = l->applied.at;
    for (int64_t k = 0; k < m; k++) {
        double given = applied[k];
        if (l->takes_law) {
            double change = 0.0;
            for (int64_t j = 0; j < n; j++)
                change += applied[m + k * n + j] * (l->end.at[j] - l->start.at[j]);
            given = given + change + applied[m * (1 + n) + k] * h;
        }
        residual[k] = l->command.at[k] - given;
        const double at_start = l->law.at[k] - applied[k];
        if (!l->corrected && fabs(at_start) > fabs(residual[k]))
            residual[k] = at_start;
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

static int save_both(Loop *l, int use)
{
    return save(&l->plant, use) && save(&l->controller.calls, use);
}

static int restore_both(Loop *l, int use)
{
    return restore(&l->plant, use) && restore(&l->controller.calls, use);
}

static void release_both(Loop *l, int use)
{
    release(&l->plant, use);
    release(&l->controller.calls, use);
}

/* Move from t to t + h while the set-points go from `before` to `after`. */
static int step(Loop *l, double t, double h, const double *before, const double *after)
{
    const int64_t count = l->outputs.size;
    signals_of(l, l->outputs.at, l->start.at);
    TRY(law_of_step(l, t, h, before, after));
    copy(l->law.at, l->applied.at, l->law.size);
    if (l->delayed && !l->corrected) {
        if (l->controller.m > 0 && isnan(l->late.at[0])) /* a co-run begins with the command that the run begins with */
            copy(l->law.at, l->late.at, l->controller.m);
        copy(l->late.at, l->applied.at, l->controller.m);
    }
    if (l->own)
        TRY(l->own(h));
    if (!l->corrected) {
        TRY(move_both(l, t, h, before, after));
        find_residual(l, h, l->residual.at);
        copy(l->reached.at, l->outputs.at, count);
        return 1;
    }
    TRY(save_both(l, CORRECTION));
    TRY(move_both(l, t, h, before, after));
    find_residual(l, h, l->first.at);
    copy(l->reached.at, l->effect.at, count);
    mend(l, h);
    TRY(restore_both(l, CORRECTION));
    TRY(move_both(l, t, h, before, after));
    release_both(l, CORRECTION);
    find_residual(l, h, l->residual.at);
    copy(l->reached.at, l->outputs.at, count);
    for (int64_t k = 0; k < count; k++)
        l->effect.at[k] = fabs(l->outputs.at[k] - l->effect.at[k]);
    l->contraction = contraction_of(l);
    return 1;
}

/* As `step`, but release the saved states if the step fails. */
static int stepped(Loop *l, double t, double h, const double *before, const double *after)
{
    if (step(l, t, h, before, after))
        return 1;
    release_both(l, CORRECTION);
    release_both(l, PROBE);
    return 0;
}

/* Save everything that `take_back` needs to undo later steps; `drop` it at the end. */
static int keep(Loop *l)
{
    TRY(save_both(l, CHECKPOINT));
    copy(l->outputs.at, l->kept_outputs.at, l->outputs.size);
    copy(l->late.at, l->kept_late.at, l->late.size);
    copy(l->following.at, l->kept_following.at, l->following.size);
    l->kept_has_following = l->has_following;
    return 1;
}

static void drop(Loop *l) { release_both(l, CHECKPOINT); }

/* Go back to the time of `keep`, and drop what it saved. */
static int take_back(Loop *l)
{
    l->plant.status = l->controller.calls.status = 0;
    copy(l->kept_outputs.at, l->outputs.at, l->outputs.size);
    copy(l->kept_late.at, l->late.at, l->late.size);
    copy(l->kept_following.at, l->following.at, l->following.size);
    l->has_following = l->kept_has_following;
    TRY(restore_both(l, CHECKPOINT));
    drop(l);
    return 1;
}
