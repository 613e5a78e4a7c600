/* Many communication steps of a loop and its reference co-runs, and what else `compiled.py` calls. */
#include "coupling.c"

#include "clock.c"

#include <stdlib.h>

#define LEAST_SHARE 1e-3 /* of the error that is allowed in all, to any one step */

enum { GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, DIVERGES, CALL_FAILED, OUT_OF_MEMORY };

#include "joint_step.c"

/* A loop with what it records. */
typedef struct {
    Loop loop;
    int64_t parts;   /* into how many a reference co-run divides each step; 0 if it is not there */
    Vector recorded; /* outputs at the end of each step, row by row */
    int64_t rows;
    double failed; /* time of the step in which a reference co-run failed [s], NaN before */
} Pair;

/* The run as it is recorded, what is measured along it, and what it is to follow. */
typedef struct {
    Vector times, references;
    Vector commands;             /* row by row */
    Vector others;               /* the controller's other outputs, row by row */
    Vector bounds;               /* of each output, beyond which the loop diverges */
    Vector nominal, low, high;   /* of each output, and its range so far */
    Vector residual, effect_rate;  /* largest of each command, and its effect on each output, per second */
    double accuracy;             /* share of an output's range that may be wrong in the end */
    double contraction, contraction_weight; /* sums of contraction by weight and of weight */
    Vector apart;                /* run and reference co-run after the last step */
    Vector goal_times, goal_values; /* the reference's points, a row each: what is recorded, then
                                       what each input takes */
    Vector before, after;           /* room for what the inputs take at two times */
} Course;

/* The set-point at a time [s] and, in `inputs`, what each input takes of it: linear between the
 * reference's points, held outside of them. */
static double set_points(const Course *c, double t, double *inputs)
{
    const double *const times = c->goal_times.at;
    const int64_t count = c->goal_times.size, width = c->before.size, row = 1 + width;
    int64_t low = 0, high = count; /* the first point after t */
    while (low < high) {
        const int64_t middle = (low + high) / 2;
        if (times[middle] <= t)
            low = middle + 1;
        else
            high = middle;
    }
    const int outside = low == 0 || low == count;
    const int64_t k = low == 0 ? 0 : low - 1; /* the last point that is not after t */
    const double *const here = c->goal_values.at + k * row, *const next = here + row;
    double recorded = here[0];
    for (int64_t j = 0; j < row; j++) {
        double value = here[j];
        if (!outside) {
            const double slope = (next[j] - here[j]) / (times[low] - times[k]);
            value = slope * (t - times[k]) + here[j];
        }
        *(j ? &inputs[j - 1] : &recorded) = value;
    }
    return recorded;
}

static int runs(const Pair *co_run)
{
    return co_run->parts > 0 && isnan(co_run->failed);
}

static void record_outputs(Pair *pair)
{
    const int64_t n = pair->loop.outputs.size;
    copy(pair->loop.outputs.at, pair->recorded.at + pair->rows * n, n);
    pair->rows++;
}

/* Move a reference co-run over the same step, in as many parts as it has, until it fails. */
static void step_co_run(Pair *pair, double t, double h, const double *before,
                           const double *after, int64_t width, double *room)
{
    if (!runs(pair))
        return;
    const int64_t parts = pair->parts;
    double *const start = room, *const end = room + width;
    for (int64_t j = 0; j < parts; j++) {
        for (int64_t k = 0; k < width; k++) {
            start[k] = before[k] + (after[k] - before[k]) * (double)j / (double)parts;
            end[k] = before[k] + (after[k] - before[k]) * (double)(j + 1) / (double)parts;
        }
        if (!stepped(&pair->loop, t + (double)j * h / (double)parts, h / (double)parts, start,
                     end)) {
            pair->failed = t;
            return;
        }
    }
}

/* The controller's outputs beside its commands. */
static int record_others(Controller *c, Course *course, int64_t row)
{
    if (!course->others.size)
        return 1;
    const int64_t all = c->calls.taken.size, count = c->others;
    TRY(take(&c->calls, all));
    copy(c->calls.taken.at + all - count, course->others.at + row * count, count);
    return 1;
}

/* Record a reference co-run's row, before a step of so many seconds and parts, or the last one. */
static void end_co_run_row(Pair *pair, double t, double h, const double *reference, int last)
{
    if (!runs(pair))
        return;
    if (settle_row(&pair->loop, t, h / (double)pair->parts, reference, last)) {
        record_outputs(pair);
    } else {
        release_both(&pair->loop, PROBE);
        pair->failed = t;
    }
}

/* How far an output of the run and of its reference co-run are from each other. */
static double apart_by(const Pair *co_run, const double *outputs, int64_t k)
{
    return runs(co_run) ? outputs[k] - co_run->loop.outputs.at[k] : 0.0;
}

/* What a step was worth: its effect, and what it costs of what it may. */
typedef struct {
    const Loop *corrected; /* whose correction tells */
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
        course->low.at[k] = fmin(course->low.at[k], outputs[k]);
        course->high.at[k] = fmax(course->high.at[k], outputs[k]);
        const double scale =
            fmax(course->high.at[k] - course->low.at[k], 1e-2 * course->nominal.at[k]);
        weight = fmax(weight, corrected->effect.at[k] / scale);
        const double moved = apart_by(co_run, outputs, k) - course->apart.at[k];
        worst = fmax(worst, fabs(moved) / scale);
    }
    const double allowed = course->accuracy * fmax(h / clock->stop, LEAST_SHARE);
    return (Judged){corrected, weight, fmax(weight, worst) / allowed};
}

/* Do up to `most` accepted steps, recorded from row 0 on; GOES_ON, or why the run ended. */
API int master_march(Pair *main, Pair *co_run, Pair *second, Clock *clock, Course *course,
                     int64_t most)
{
    Loop *const loop = &main->loop;
    const int64_t n = loop->outputs.size, m = loop->controller.m, width = course->before.size;
    double *const before = course->before.at, *const after = course->after.at;
    double *const outputs = loop->outputs.at;
    double *const room = malloc((size_t)(2 * width + 1) * sizeof *room);
    if (!room)
        return OUT_OF_MEMORY;
    int why = GOES_ON;
    main->rows = co_run->rows = second->rows = 0;
    set_points(course, clock_now(clock), before);
    while (why == GOES_ON && !clock_done(clock) && main->rows < most) {
        const double t = clock_now(clock), h = clock_step_to_come(clock), end = next_time(clock);
        const double goal = set_points(course, end, after);
        const int kept = clock->adaptive && runs(co_run);
        if ((clock->adaptive && !keep(loop)) || (kept && !keep(&co_run->loop))) {
            why = CALL_FAILED;
            break;
        }
        if (!stepped(loop, t, h, before, after)) {
            drop(loop);
            drop(&co_run->loop);
            why = STEP_FAILED;
            break;
        }
        step_co_run(co_run, t, h, before, after, width, room);
        step_co_run(second, t, h, before, after, width, room);
        const Judged judged = judge_step(main, co_run, clock, course, h);
        if (clock->adaptive) {
            if (judged.share > 1.0 && clock->stride > 1) {
                if (!take_back(loop) || (kept && !take_back(&co_run->loop))) {
                    why = CALL_FAILED;
                    break;
                }
                if (kept) {
                    co_run->rows = main->rows;
                    co_run->failed = NAN;
                }
                clock_adapt(clock, judged.share);
                continue;
            }
            drop(loop);
            drop(&co_run->loop);
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
        }
        if (clock->adaptive)
            clock_adapt(clock, judged.share);
        const double following = clock_done(clock) ? h : clock_step_to_come(clock);
        const int64_t row = main->rows;
        double *const commands = course->commands.at + row * m;
        if (course->commands.size && /* a step of another length may follow where none are kept */
            !command_now(loop, end, following, after, clock_done(clock), commands)) {
            release_both(loop, CORRECTION);
            release_both(loop, PROBE);
            why = COMMAND_FAILED;
            break;
        }
        if (!settle_row(loop, end, following, after, clock_done(clock))) {
            release_both(loop, PROBE);
            why = STEP_FAILED;
            break;
        }
        if (!record_others(&loop->controller, course, row)) {
            why = COMMAND_FAILED;
            break;
        }
        end_co_run_row(co_run, end, following, after, clock_done(clock));
        end_co_run_row(second, end, following, after, clock_done(clock));
        course->times.at[row] = end;
        course->references.at[row] = goal;
        record_outputs(main);
        copy(after, before, width);
        for (int64_t k = 0; k < n; k++) {
            if (!isfinite(outputs[k]))
                why = NOT_FINITE;
            else if (why == GOES_ON && fabs(outputs[k]) > course->bounds.at[k])
                why = DIVERGES;
        }
    }
    free(room);
    return why;
}

/* -- single questions ------------------------------------------------------------------------- */

API int master_read_outputs(Calls *plant, double *outputs)
{
    return read_outputs(plant, outputs);
}

API int master_command(Loop *loop, double t, double h, const double *reference, int last,
                       double *commands)
{
    return command_now(loop, t, h, reference, last, commands);
}

API int master_set_inputs(Controller *c, const double *signals, const double *reference)
{
    return set_inputs(c, signals, reference);
}

API int master_read_commands(Controller *c, double *commands)
{
    return read_commands(c, commands);
}

API int master_command_at(Controller *c, const double *signals, const double *reference,
                          double *commands)
{
    return command_at(c, signals, reference, commands);
}

API int master_probe_gains(Controller *c, double t, double h, const double *signals,
                           const double *reference, double *law)
{
    return probe_gains(c, t, h, signals, reference, law);
}

API int master_law_at(Controller *c, double t, double h, const double *signals,
                      const double *reference, int probe, double *law)
{
    return law_at(c, t, h, signals, reference, probe, law);
}

API int master_advance(Controller *c, double t, double h, const double *signals,
                       const double *reference)
{
    return advance(c, t, h, signals, reference);
}
