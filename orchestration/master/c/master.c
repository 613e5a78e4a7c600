/* Communication steps of a loop and its reference co-runs; other functions for `compiled.py`. */
#include "coupling.c"

#include "clock.c"

#define LEAST_SHARE 1e-3 /* of the total allowed error, which any one step may have */

enum { GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, DIVERGES, CALL_FAILED };

#include "joint_step.c"
#include "group.c"

/* A loop and its record. */
typedef struct {
    Loop loop;
    int64_t parts;   /* of each step of a reference co-run; 0 if there is no co-run */
    Vector recorded; /* outputs of the plant and others of the controller at the end of each step */
    int64_t rows;
    double failed; /* time of the step in which a reference co-run failed [s], else NaN */
} Pair;

/* The record of a run, the measurements during it, and its reference. */
typedef struct {
    Vector times, references;
    Vector commands;             /* row by row */
    Vector bounds;               /* of each output, beyond which the loop diverges */
    Vector nominal, low, high;   /* of each output, and its range so far */
    Vector residual, effect_rate;  /* largest of each command, and its effect on each output, per second */
    double accuracy;             /* allowed error at the end, as a share of an output's range */
    double contraction, contraction_weight; /* sums of contraction by weight and of weight */
    Vector apart;                /* difference of run and reference co-run after the last step */
    /* the reference's points; a constant before them and polynomials in the time since each of
     * them: for the recorded set-point, then for each input */
    Vector goal_times, goal_pieces;
    Vector before, after; /* room for the inputs' set-points at two times */
} Course;

enum { FROM_BEFORE, FROM_THEN_ON }; /* on which side of a jump */

/* Return the set-point at a time [s], and put each input's value of it into `inputs`. Points of the
 * reference within `close` count as points at this time. */
static double set_points(const Course *c, double t, int side, double close, double *inputs)
{
    const double *const times = c->goal_times.at;
    const int64_t count = c->goal_times.size, row = 1 + c->before.size;
    const int64_t terms = c->goal_pieces.size / ((count + 1) * row);
    const double bound = side == FROM_BEFORE ? t - close : t + close;
    int64_t low = 0, high = count; /* the first point after the bound */
    while (low < high) {
        const int64_t middle = (low + high) / 2;
        if (times[middle] <= bound)
            low = middle + 1;
        else
            high = middle;
    }
    double since = low > 0 ? fmax(t - times[low - 1], 0.0) : 0.0;
    if (low > 0 && low < count)
        since = fmin(since, times[low] - times[low - 1]);
    const double *piece = c->goal_pieces.at + low * row * terms;
    double recorded = 0.0;
    for (int64_t j = 0; j < row; j++, piece += terms) {
        double value = 0.0;
        for (int64_t k = terms - 1; k >= 0; k--)
            value = value * since + piece[k];
        *(j ? &inputs[j - 1] : &recorded) = value;
    }
    return recorded;
}

static int runs(const Pair *co_run)
{
    return co_run->parts > 0 && isnan(co_run->failed);
}

static int record_outputs(Pair *pair, const double *reference)
{
    Controller *const c = &pair->loop.controller;
    const int64_t n = pair->loop.outputs.size, all = c->calls.taken.size;
    double *const row = pair->recorded.at + pair->rows * (n + c->others);
    copy(pair->loop.outputs.at, row, n);
    if (c->others) {
        if (c->group) {
            signals_of(&pair->loop, row, pair->loop.start.at);
            TRY(master_set_inputs(c, pair->loop.start.at, reference));
        }
        TRY(take(&c->calls, all));
        copy(c->calls.taken.at + all - c->others, row + n, c->others);
    }
    pair->rows++;
    return 1;
}

/* Put the set-points just after a time into `before`; if they jump, discard the law that the loop
 * has from before the jump. */
static void begin_step_at(Loop *l, Course *course, double t, double close)
{
    double *const before = course->before.at, *const after = course->after.at;
    set_points(course, t, FROM_BEFORE, close, after);
    set_points(course, t, FROM_THEN_ON, close, before);
    for (int64_t k = 0; k < course->before.size; k++)
        if (before[k] != after[k])
            l->has_following = 0;
}

/* Move a loop over a step of length `h` to the time `end`, in the number of parts of the pair. */
static int stepped_along(Pair *pair, Course *course, double t, double h, double end, double close)
{
    const double parts = (double)pair->parts;
    for (int64_t j = 0; j < pair->parts; j++) {
        const double begin = t + (double)j * h / parts;
        begin_step_at(&pair->loop, course, begin, close);
        set_points(course, j + 1 < pair->parts ? t + (double)(j + 1) * h / parts : end, FROM_BEFORE,
                   close, course->after.at);
        if (!stepped(&pair->loop, begin, h / parts, course->before.at, course->after.at))
            return 0;
    }
    return 1;
}

/* End a step of a reference co-run; the next step is `following` seconds long, if there is one. */
static void end_co_run_step(Pair *pair, Course *course, const Clock *clock, double following)
{
    const double t = clock_now(clock);
    if (!runs(pair))
        return;
    begin_step_at(&pair->loop, course, t, clock->close);
    if (!settle_row(&pair->loop, t, following / (double)pair->parts, course->before.at,
                    clock_done(clock))) {
        release_both(&pair->loop, PROBE);
        pair->failed = t;
    } else if (!clock->broken && !record_outputs(pair, course->before.at)) {
        pair->failed = t;
    }
}

/* Difference of an output of the run from that of its reference co-run. */
static double apart_by(const Pair *co_run, const double *outputs, int64_t k)
{
    return runs(co_run) ? outputs[k] - co_run->loop.outputs.at[k] : 0.0;
}

/* Result of a step: the effect of its correction, and its error as a share of the allowed one. */
typedef struct {
    const Loop *corrected; /* the loop whose correction is used */
    double weight, share;
} Judged;

static Judged judge_step(const Pair *main, const Pair *co_run, const Clock *clock, Course *course,
                         double h)
{
    const double *const outputs = main->loop.outputs.at;
    const Loop *const corrected =
        co_run->loop.corrected && runs(co_run) ? &co_run->loop : &main->loop;
    double weight = 0.0, worst = 0.0;
    for (int64_t k = 0; k < main->loop.outputs.size; k++) {
        const double range =
            fmax(course->high.at[k], outputs[k]) - fmin(course->low.at[k], outputs[k]);
        const double scale = fmax(range, 1e-2 * course->nominal.at[k]);
        weight = fmax(weight, corrected->effect.at[k] / scale);
        const double moved = apart_by(co_run, outputs, k) - course->apart.at[k];
        worst = fmax(worst, fabs(moved) / scale);
    }
    const double allowed = course->accuracy * fmax(h / clock->stop, LEAST_SHARE);
    return (Judged){corrected, weight, fmax(weight, worst) / allowed};
}

/* Do up to `most` accepted steps, recorded from row 0 on; return GOES_ON, or why the run ended.
 * Steps that end at breaks of the clock are not recorded. */
API int master_march(Pair *main, Pair *co_run, Pair *second, Clock *clock, Course *course,
                     int64_t most)
{
    Loop *const loop = &main->loop;
    Pair *const pairs[] = {main, co_run, second};
    const int64_t n = loop->outputs.size, m = loop->controller.m;
    const double close = clock->close;
    double *const outputs = loop->outputs.at;
    int why = GOES_ON;
    main->rows = co_run->rows = second->rows = 0;
    while (why == GOES_ON && !clock_done(clock) && main->rows < most) {
        const double t = clock_now(clock), h = clock_step_to_come(clock), end = next_time(clock);
        int kept[] = {0, 0, 0};
        for (int k = 0; k < 3 && why == GOES_ON; k++) {
            kept[k] = clock->adaptive && runs(pairs[k]);
            if (kept[k] && !keep(&pairs[k]->loop))
                why = CALL_FAILED;
        }
        if (why != GOES_ON)
            break;
        for (int k = 0; k < 3 && why == GOES_ON; k++) {
            if (!runs(pairs[k]) || stepped_along(pairs[k], course, t, h, end, close))
                continue;
            if (k == 0)
                why = STEP_FAILED;
            else
                pairs[k]->failed = t;
        }
        if (why != GOES_ON) {
            for (int k = 0; k < 3; k++)
                if (kept[k])
                    drop(&pairs[k]->loop);
            break;
        }
        const Judged judged = judge_step(main, co_run, clock, course, h);
        if (clock->adaptive) {
            if (judged.share > 1.0 && clock->stride > 1) {
                for (int k = 0; k < 3 && why == GOES_ON; k++) {
                    if (!kept[k])
                        continue;
                    if (!take_back(&pairs[k]->loop))
                        why = CALL_FAILED;
                    pairs[k]->failed = NAN;
                }
                clock_adapt(clock, judged.share);
                continue;
            }
            for (int k = 0; k < 3; k++)
                if (kept[k])
                    drop(&pairs[k]->loop);
        }
        clock_accept(clock);
        const double contraction = judged.corrected->contraction;
        if (isfinite(contraction) && judged.weight > 0.0) {
            course->contraction += contraction * judged.weight;
            course->contraction_weight += judged.weight;
        }
        for (int64_t k = 0; k < m; k++)
            course->residual.at[k] = fmax(course->residual.at[k], fabs(loop->residual.at[k]));
        for (int64_t k = 0; k < n; k++) {
            course->effect_rate.at[k] =
                fmax(course->effect_rate.at[k], judged.corrected->effect.at[k] / h);
            course->apart.at[k] = apart_by(co_run, outputs, k);
            course->low.at[k] = fmin(course->low.at[k], outputs[k]);
            course->high.at[k] = fmax(course->high.at[k], outputs[k]);
        }
        if (clock->adaptive)
            clock_adapt(clock, judged.share);
        const double following = clock_done(clock) ? h : clock_step_to_come(clock);
        const int64_t row = main->rows;
        double *const commands = course->commands.at + row * m;
        begin_step_at(loop, course, end, close);
        /* if no commands are kept, a step of another length may follow */
        if (course->commands.size && !clock->broken &&
            !master_command_now(loop, end, following, course->before.at, clock_done(clock),
                                commands)) {
            release_both(loop, CORRECTION);
            release_both(loop, PROBE);
            why = COMMAND_FAILED;
            break;
        }
        if (!settle_row(loop, end, following, course->before.at, clock_done(clock))) {
            release_both(loop, PROBE);
            why = STEP_FAILED;
            break;
        }
        if (!clock->broken && !record_outputs(main, course->before.at)) {
            why = COMMAND_FAILED;
            break;
        }
        end_co_run_step(co_run, course, clock, following);
        end_co_run_step(second, course, clock, following);
        if (clock->broken)
            continue;
        course->times.at[row] = end;
        course->references.at[row] =
            set_points(course, end, FROM_THEN_ON, close, course->before.at);
        for (int64_t k = 0; k < n; k++) {
            if (!isfinite(outputs[k]))
                why = NOT_FINITE;
            else if (why == GOES_ON && fabs(outputs[k]) > course->bounds.at[k])
                why = DIVERGES;
        }
    }
    return why;
}

/* The size of the records, which `compiled.py` reads from these sources. */
API const int64_t master_size = sizeof(Pair) + sizeof(Course) + sizeof(Clock) + sizeof(Joint) +
                                sizeof(Trail) + sizeof(Group) + sizeof(Member);
