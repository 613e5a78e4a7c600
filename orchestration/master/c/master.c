/* Communication steps of a loop and its reference co-runs; other functions for `compiled.py`. */
#include "coupling.c"

#include "clock.c"

#define LEAST_SHARE 1e-3 /* of the total allowed error, which any one step may have */

enum { GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, DIVERGES, CALL_FAILED };

#include "joint_step.c"
#include "group.c"

/* The record of a run, the measurements during it, and its reference. */
typedef struct {
    Vector times, references;
    Vector commands;            /* row by row; empty if none are kept */
    Vector bounds;              /* of each output, beyond which the loop diverges */
    Vector nominal, low, high;  /* of each output, and its range so far */
    Vector residual;            /* largest of each command */
    Vector effect_rate;         /* largest effect of the residual on each output, per second */
    double accuracy;            /* allowed error at the end, as a share of an output's range */
    double weight;              /* effect of the last step's correction, as a share of a range */
    double contraction, contraction_weight; /* sums of contraction by weight and of weight */
    Vector apart;               /* difference of run and reference co-run after the last step */
    /* the reference's points; a constant before them and polynomials in the time since each of
     * them: for the recorded set-point, then for each input */
    Vector goal_times, goal_pieces;
    Vector before, after;       /* room for these set-points at two times */
} Course;

/* Put the set-points at a time [s] into `values`, from the last point of the reference up to `bound`:
 * a little before or after the time, since points so close to it count as points at this time. */
static void set_points(const Course *c, double t, double bound, double *values)
{
    const double *const times = c->goal_times.at;
    const int64_t count = c->goal_times.size, row = c->before.size;
    const int64_t terms = c->goal_pieces.size / ((count + 1) * row);
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
    for (int64_t j = 0; j < row; j++, piece += terms) {
        double value = 0.0;
        for (int64_t k = terms - 1; k >= 0; k--)
            value = value * since + piece[k];
        values[j] = value;
    }
}

static int runs(const Loop *l) { return isnan(l->failed); }

/* Put the set-points just after a time into `before`; if they jump, discard the law that the loop
 * has from before the jump. */
static void begin_step_at(Loop *l, Course *course, double t, double close)
{
    set_points(course, t, t - close, course->after.at);
    set_points(course, t, t + close, course->before.at);
    if (differ(course->before.at + 1, course->after.at + 1, course->before.size - 1))
        l->following_step = NAN;
}

/* Move a loop over the next step of the clock, in the number of its parts. */
static int step_along(Loop *l, Course *course, const Clock *clock)
{
    const double t = clock_now(clock), h = clock_step_to_come(clock), close = clock->close;
    const double parts = (double)l->parts;
    int done = 1;
    for (int64_t j = 0; j < l->parts && done; j++) {
        const double begin = t + (double)j * h / parts;
        const double end = j + 1 < l->parts ? t + (double)(j + 1) * h / parts : next_time(clock);
        begin_step_at(l, course, begin, close);
        set_points(course, end, end - close, course->after.at);
        done = step(l, begin, h / parts, course->before.at + 1, course->after.at + 1);
    }
    if (!done) {
        release_both(&l->plant, &l->controller.calls, CORRECTION);
        release_both(&l->plant, &l->controller.calls, PROBE);
    }
    return done;
}

/* Move all loops over the next step of the clock; with adaptive steps, it can be taken back. */
static int step_all(Loop *const *loops, int64_t count, const Clock *clock, Course *course)
{
    for (int64_t k = 0; k < count && clock->adaptive; k++) {
        if (runs(loops[k]) && !keep(loops[k]))
            return CALL_FAILED;
    }
    for (int64_t k = 0; k < count; k++) {
        if (!runs(loops[k]) || step_along(loops[k], course, clock))
            continue;
        if (k == 0)
            return STEP_FAILED;
        loops[k]->failed = clock_now(clock);
    }
    return GOES_ON;
}

static int record_outputs(Loop *l, const double *reference)
{
    Controller *const c = &l->controller;
    const int64_t n = l->outputs.size, all = c->calls.taken.size;
    double *const row = l->recorded.at + l->rows * (n + c->others);
    copy(l->outputs.at, row, n);
    if (c->others) {
        if (c->group) {
            signals_of(l, row, l->start.at);
            TRY(master_set_inputs(c, l->start.at, reference));
        }
        TRY(take(&c->calls, all));
        copy(c->calls.taken.at + all - c->others, row + n, c->others);
    }
    l->rows++;
    return 1;
}

/* End a step of a loop: record its row, of the `run` with its commands, unless it ends at a break.
 * The next step is `following` seconds long, if there is one. */
static int end_step(Loop *l, Course *course, const Clock *clock, double following, int run)
{
    const int last = clock_done(clock);
    const double t = clock_now(clock), *const goal = course->before.at + 1;
    double *const commands = course->commands.at + l->rows * l->controller.m;
    int why = GOES_ON;
    begin_step_at(l, course, t, clock->close);
    /* if no commands are kept, a step of another length may follow */
    if (run && course->commands.size && !clock->broken &&
        !master_command_now(l, t, following, goal, last, commands))
        why = COMMAND_FAILED;
    else if (!settle_row(l, t, following / (double)l->parts, goal, last))
        why = STEP_FAILED;
    else if (!clock->broken && !record_outputs(l, goal))
        why = COMMAND_FAILED;
    if (why != GOES_ON)
        release_both(&l->plant, &l->controller.calls, PROBE);
    return why;
}

/* Difference of an output of the run from that of its reference co-run, if there is one. */
static double apart_by(const Loop *run, const Loop *co_run, int64_t k)
{
    return co_run ? run->outputs.at[k] - co_run->outputs.at[k] : 0.0;
}

/* The error of the last step, as a share of the allowed one. */
static double share_of_step(const Loop *run, const Loop *corrected, const Loop *co_run,
                            const Clock *clock, Course *course, double h)
{
    double worst = 0.0;
    course->weight = 0.0;
    for (int64_t k = 0; k < run->outputs.size; k++) {
        const double now = run->outputs.at[k];
        const double range = fmax(course->high.at[k], now) - fmin(course->low.at[k], now);
        const double scale = fmax(range, 1e-2 * course->nominal.at[k]);
        course->weight = fmax(course->weight, corrected->effect.at[k] / scale);
        const double moved = apart_by(run, co_run, k) - course->apart.at[k];
        worst = fmax(worst, fabs(moved) / scale);
    }
    const double allowed = course->accuracy * fmax(h / clock->stop, LEAST_SHARE);
    return fmax(course->weight, worst) / allowed;
}

/* Add an accepted step to the measurements. */
static void measure(const Loop *run, const Loop *corrected, const Loop *co_run, Course *course,
                    double h)
{
    if (isfinite(corrected->contraction) && course->weight > 0.0) {
        course->contraction += corrected->contraction * course->weight;
        course->contraction_weight += course->weight;
    }
    for (int64_t k = 0; k < run->controller.m; k++)
        course->residual.at[k] = fmax(course->residual.at[k], fabs(run->residual.at[k]));
    for (int64_t k = 0; k < run->outputs.size; k++) {
        const double rate = corrected->effect.at[k] / h;
        course->effect_rate.at[k] = fmax(course->effect_rate.at[k], rate);
        course->apart.at[k] = apart_by(run, co_run, k);
        course->low.at[k] = fmin(course->low.at[k], run->outputs.at[k]);
        course->high.at[k] = fmax(course->high.at[k], run->outputs.at[k]);
    }
}

static int judge_outputs(const Loop *run, const Course *course)
{
    int why = GOES_ON;
    for (int64_t k = 0; k < run->outputs.size; k++) {
        if (!isfinite(run->outputs.at[k]))
            why = NOT_FINITE;
        else if (why == GOES_ON && fabs(run->outputs.at[k]) > course->bounds.at[k])
            why = DIVERGES;
    }
    return why;
}

/* Move a run, the first loop, and its reference co-runs by up to `most` accepted steps, recorded from
 * row 0 on; return GOES_ON, or why the run ended. Steps that end at breaks are not recorded. */
API int master_march(Loop *const *loops, int64_t count, Clock *clock, Course *course, int64_t most)
{
    Loop *const run = loops[0];
    int why = GOES_ON;
    for (int64_t k = 0; k < count; k++)
        loops[k]->rows = 0;
    while (why == GOES_ON && !clock_done(clock) && run->rows < most) {
        const double h = clock_step_to_come(clock);
        why = step_all(loops, count, clock, course);
        const Loop *const co_run = count > 1 && runs(loops[1]) ? loops[1] : NULL;
        const Loop *const corrected = co_run && co_run->corrected ? co_run : run;
        const double share = share_of_step(run, corrected, co_run, clock, course, h);
        const int again = why == GOES_ON && clock->adaptive && share > 1.0 && clock->stride > 1;
        for (int64_t k = 0; k < count; k++) {
            if (again && loops[k]->plant.states.at[CHECKPOINT] && !take_back(loops[k]))
                why = CALL_FAILED;
            drop(loops[k]);
        }
        if (!again && why == GOES_ON) {
            clock_accept(clock);
            measure(run, corrected, co_run, course, h);
        }
        if (clock->adaptive)
            clock_adapt(clock, share);
        if (again || why != GOES_ON)
            continue;
        const double following = clock_done(clock) ? h : clock_step_to_come(clock);
        why = end_step(run, course, clock, following, 1);
        for (int64_t k = 1; k < count && why == GOES_ON; k++) {
            if (runs(loops[k]) && end_step(loops[k], course, clock, following, 0) != GOES_ON)
                loops[k]->failed = clock_now(clock);
        }
        if (why == GOES_ON && !clock->broken) {
            course->times.at[run->rows - 1] = clock_now(clock);
            course->references.at[run->rows - 1] = course->before.at[0];
            why = judge_outputs(run, course);
        }
    }
    return why;
}

/* The size of the records, which `compiled.py` reads from these sources. */
API const int64_t master_size = sizeof(Loop) + sizeof(Course) + sizeof(Clock) + sizeof(Joint) +
                                sizeof(Trail) + sizeof(Group) + sizeof(Member);
