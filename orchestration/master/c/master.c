/* Communication steps of a loop and its co-run; other functions for `compiled.py`. */
#include "coupling.c"

#include "clock.c"

enum { GOES_ON, STEP_FAILED, DIVERGES };

/* Whether no value is beyond its bound, or not a number. */
static int within(const double *values, const Vector *bounds)
{
    int64_t k = 0;
    while (k < bounds->size && fabs(values[k]) <= bounds->at[k])
        k++;
    return k == bounds->size;
}

#include "joint_step.c"
#include "group.c"
#include "remote.c"

/* The record of a run, the measurements during it, and its reference. */
typedef struct {
    Vector times, references;
    Vector commands;            /* row by row; empty if none are kept */
    Vector bounds;              /* of each output, beyond which the loop diverges */
    Vector nominal, low, high;  /* of each output, and its range so far */
    Vector residual;            /* largest of each command */
    Vector effect_rate;         /* largest effect of the residual on each output, per second */
    double contraction, weight; /* sums over the steps: of contraction by weight, and of weight */
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

/* Put the set-points just after a time into `before`; if they jump, discard the law before. */
static void begin_step_at(Loop *l, Course *course, double t, double close)
{
    set_points(course, t, t - close, course->after.at);
    set_points(course, t, t + close, course->before.at);
    if (differ(course->before.at + 1, course->after.at + 1, course->before.size - 1))
        l->following_step = NAN;
}

/* Move a loop over the next step of the clock. */
static int step_along(Loop *l, Course *course, const Clock *clock)
{
    const double t = clock_now(clock), end = l->until = next_time(clock);
    begin_step_at(l, course, t, clock->close);
    set_points(course, end, end - clock->close, course->after.at);
    return step(l, t, clock_step_to_come(clock), course->before.at + 1, course->after.at + 1);
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
    begin_step_at(l, course, t, clock->close);
    /* if no commands are kept, a step of another length may follow */
    const int asks = run && course->commands.size && !clock->broken;
    return (!asks || master_command_now(l, t, following, goal, last, commands)) &&
           settle_row(l, t, following, goal, last) && (clock->broken || record_outputs(l, goal));
}

/* Add a step to the measurements; contraction counts by its effect over the outputs' ranges. */
static void measure(const Loop *run, const Loop *corrected, Course *course, double h)
{
    double weight = 0.0;
    for (int64_t k = 0; k < run->controller.m; k++)
        course->residual.at[k] = fmax(course->residual.at[k], fabs(run->residual.at[k]));
    for (int64_t k = 0; k < run->outputs.size; k++) {
        const double effect = corrected->effect.at[k];
        course->low.at[k] = fmin(course->low.at[k], run->outputs.at[k]);
        course->high.at[k] = fmax(course->high.at[k], run->outputs.at[k]);
        const double range = course->high.at[k] - course->low.at[k];
        weight = fmax(weight, effect / fmax(range, 1e-2 * course->nominal.at[k]));
        course->effect_rate.at[k] = fmax(course->effect_rate.at[k], effect / h);
    }
    if (isfinite(corrected->contraction) && weight > 0.0) {
        course->contraction += corrected->contraction * weight;
        course->weight += weight;
    }
}

/* Forget all saved states. */
static void forget(Loop *l)
{
    for (int use = 0; use < USES; use++)
        release_both(&l->plant, &l->controller.calls, use);
    l->controller.tried.at[1] = 0.0;
}

/* Move a run, and a co-run that corrects its steps if there is one, by up to `most` steps, recorded
 * from row 0 on; return GOES_ON, or why the run ended. Steps that end at breaks are not recorded. */
API int master_march(Loop *run, Loop *co_run, Clock *clock, Course *course, int64_t most)
{
    int why = GOES_ON;
    run->rows = 0;
    if (co_run)
        co_run->rows = 0;
    while (why == GOES_ON && !clock_done(clock) && run->rows < most) {
        const double h = clock_step_to_come(clock);
        why = STEP_FAILED;
        if (!step_along(run, course, clock))
            break;
        if (co_run && isnan(co_run->failed) && !step_along(co_run, course, clock))
            co_run->failed = clock_now(clock);
        Loop *const corrected = co_run && isnan(co_run->failed) ? co_run : run;
        clock_accept(clock);
        measure(run, corrected, course, h);
        const double following = clock_done(clock) ? h : clock_step_to_come(clock);
        if (!end_step(run, course, clock, following, 1))
            break;
        why = GOES_ON;
        if (corrected != run && !end_step(corrected, course, clock, following, 0))
            co_run->failed = clock_now(clock);
        if (clock->broken)
            continue;
        course->times.at[run->rows - 1] = clock_now(clock);
        course->references.at[run->rows - 1] = course->before.at[0];
        why = within(run->outputs.at, &course->bounds) ? GOES_ON : DIVERGES;
    }
    forget(run);
    if (co_run)
        forget(co_run);
    return why;
}

/* The size of the records, which `compiled.py` reads from these sources. */
API const int64_t master_size = sizeof(Loop) + sizeof(Course) + sizeof(Clock) + sizeof(Joint) +
                                sizeof(Trail) + sizeof(Group) + sizeof(Member) + sizeof(Line) +
                                sizeof(Remote) + sizeof(Served);
