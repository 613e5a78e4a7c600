#include "tangents.h"

/* Two rules' integrals of the Jacobian over a step may differ by TOLERANCE * rtol**ORDER, over the
 * states' magnitudes [nats]: both are of order four, the stepper is of order five. */
#define TOLERANCE 1.0
#define ORDER 0.45
#define STILL 1e-10    /* share of the Jacobian: a smaller change in a step counts as constant */
#define SHORTEST 1e-14 /* step over time: shorter steps are not repeated */
#define RANK 1e-12     /* share of a matrix' first pivot: a smaller pivot counts as zero */
#define ROOT_3 1.7320508075688772
#define GAUSS (0.5 - ROOT_3 / 6.0)
#define HEAVY ((3.0 + 2.0 * ROOT_3) / 12.0)
#define LIGHT ((3.0 - 2.0 * ROOT_3) / 12.0)

/* One accepted step of the stepper, and scratch memory for its tangents. */
typedef struct {
    double *first, *last, *slope0, *slope1; /* states at both ends, and their rates */
    double *by_time, *at, *logs, *changes;
    double *j1, *j2, *omega, *mean; /* n x n */
    double *at_end;                 /* n x n: the Jacobian there */
    double *radau;                  /* 3 x n x n */
    double *slow;                   /* count x n */
    Propagation propagation;
    double rate; /* nats per second between first and last tangent */
} Step;

#define STEP_DOUBLES(n) (9 * (n) * (n) + 8 * (n) + PROPAGATION_DOUBLES(n))
#define NOTE_DOUBLES(n) (3 * (n) * (n) + 4 * (n))

static void lay_step(Step *own, int n, double *next)
{
    TAKE(first, n), TAKE(last, n), TAKE(slope0, n), TAKE(slope1, n);
    TAKE(by_time, n), TAKE(at, n), TAKE(logs, n), TAKE(changes, n);
    TAKE(j1, n * n), TAKE(j2, n * n), TAKE(omega, n * n), TAKE(mean, n * n), TAKE(at_end, n * n);
    TAKE(radau, 3 * n * n), TAKE(slow, n * n);
    lay_propagation(&own->propagation, n, next);
    own->rate = 0.0;
}

static void lay_note(Note *own, int n, double *next)
{
    own->any = 0;
    TAKE(w, n), TAKE(b, n), TAKE(gradient, n), TAKE(by_time, n);
    TAKE(a, n * n), TAKE(reset, n * n), TAKE(product, n * n);
}

/* The state at the share q of a step. */
static void place(const Step *step, int n, double q, double h)
{
    hermite(n, q, h, step->first, step->slope0, step->last, step->slope1, step->at);
}

/* Logarithm of the size of a matrix' determinant; the matrix is overwritten. */
static double log_determinant(double *matrix, int32_t *pivots, int n)
{
    if (!factorize(matrix, pivots, n))
        return -HUGE_VAL;
    double total = 0.0;
    for (int i = 0; i < n; i++)
        total -= log(fabs(matrix[i * n + i]));
    return total;
}

/* Rank of a matrix that maps states to states, by elimination with full pivoting; overwritten. */
static int rank_of(double *matrix, int n, const double *scale)
{
    double first = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            matrix[i * n + j] *= scale[j] / scale[i];
    for (int k = 0; k < n; k++) {
        int row = k, column = k;
        for (int i = k; i < n; i++)
            for (int j = k; j < n; j++)
                if (fabs(matrix[i * n + j]) > fabs(matrix[row * n + column])) {
                    row = i;
                    column = j;
                }
        const double pivot = matrix[row * n + column];
        if (k == 0)
            first = fabs(pivot);
        if (!(fabs(pivot) > RANK * first))
            return k;
        for (int j = 0; j < n; j++) {
            const double other = matrix[k * n + j];
            matrix[k * n + j] = matrix[row * n + j];
            matrix[row * n + j] = other;
        }
        for (int i = 0; i < n; i++) {
            const double other = matrix[i * n + k];
            matrix[i * n + k] = matrix[i * n + column];
            matrix[i * n + column] = other;
        }
        for (int i = k + 1; i < n; i++) {
            const double factor = matrix[i * n + k] / pivot;
            for (int j = k; j < n; j++)
                matrix[i * n + j] -= factor * matrix[k * n + j];
        }
    }
    return n;
}

/* Move the row of `frame` that is nearest to the span of the rows before it behind all others: if a
 * matrix has removed a direction, only round-off is left of it. `copy` is scratch. */
static void put_last(double *frame, int count, int n, double *logs, double *copy)
{
    memcpy(copy, frame, (size_t)(count * n) * sizeof *copy);
    int worst = count - 1;
    double least = HUGE_VAL;
    for (int j = 0; j < count; j++) {
        double before = 0.0;
        for (int i = 0; i < n; i++)
            before += copy[j * n + i] * copy[j * n + i];
        const double square = free_of_others(copy, j, n);
        const double share = before > 0.0 ? square / before : 0.0;
        if (share < least) {
            least = share;
            worst = j;
        }
        for (int i = 0; i < n && square > 0.0; i++)
            copy[j * n + i] /= sqrt(square);
    }
    double *const own = frame + worst * n;
    memmove(own, own + n, (size_t)((count - 1 - worst) * n) * sizeof *own);
    memmove(logs + worst, logs + worst + 1, (size_t)(count - 1 - worst) * sizeof *logs);
}

/* Apply the noted events to the tangents; return the logarithm of their matrix' determinant.
 * `timed`: a state determines their time, not an input that has jumped. */
static double jump(const System *s, double t, const Walk *w, const double *x, double *growth,
                   const Note *note, int timed, Step *step)
{
    const int n = s->states;
    s->rhs(s, t, x, w->u, w->p, step->at);
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            step->omega[i * n + j] = note->a[i * n + j];
            if (timed)
                step->omega[i * n + j] += (step->at[i] - note->b[i]) * note->w[j];
        }
    }
    apply(step->omega, w->frame, w->count, n, step->at);
    memcpy(step->mean, step->omega, (size_t)(n * n) * sizeof(double));
    const int rank = rank_of(step->mean, n, w->scale);
    const int left = rank < w->count ? rank : w->count;
    for (int count = w->count; count > left; count--)
        put_last(w->frame, count, n, growth, step->slow);
    orthonormalize(w->frame, left, n, growth);
    for (int j = left; j < w->count; j++) {
        any_other(w->frame, j, n);
        growth[j] = -HUGE_VAL;
    }
    return rank < n ? -HUGE_VAL : log_determinant(step->omega, step->propagation.pivots, n);
}

/* Find Jacobians over a step from t by h: their mean, and those at Gauss' points and at the end.
 * Returns the difference of two rules' integrals: the stepper controls the error of the state only,
 * and that of tangents may be larger. `work` still holds rate and Jacobian at the start of the
 * step. */
static double look_at_step(const System *s, const Walk *w, double t, double h, const Work *work,
                           Step *step)
{
    const int n = s->states;
    memcpy(step->slope0, work->first, (size_t)n * sizeof(double));
    s->rhs(s, t + h, step->last, w->u, w->p, step->slope1);
    const double places[] = {GAUSS, 1.0 - GAUSS, 0.5, 1.0};
    double *const jacobians[] = {step->j1, step->j2, step->omega, step->at_end};
    for (int k = 0; k < 4; k++) {
        place(step, n, places[k], h);
        s->jac(s, t + places[k] * h, step->at, w->u, w->p, jacobians[k], step->by_time);
    }
    /* Simpson's rule for the trace: other points than the propagator's */
    for (int at = 0; at < n * n; at++)
        step->mean[at] = 1.0 / 6.0 * work->jacobian[at] + 4.0 / 6.0 * step->omega[at] +
                         1.0 / 6.0 * step->at_end[at];
    double apart = 0.0;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            const int at = i * n + j;
            const double gap = step->mean[at] - 0.5 * (step->j1[at] + step->j2[at]);
            apart = larger(apart, fabs(gap) * h * w->scale[j] / w->scale[i]);
        }
    }
    return apart;
}

/* Number of the first tangents to collocate; 0 if the Jacobian is constant, since exponentials are
 * exact then. */
static int how_many_slow(const Walk *w, int n, double h, Step *step)
{
    if (!w->collocating)
        return 0;
    double turning = 0.0, largest = 0.0;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            const double ratio = w->scale[j] / w->scale[i];
            const int at = i * n + j;
            turning = larger(turning, fabs(step->j1[at] - step->j2[at]) * ratio);
            largest = larger(largest, fabs(step->j1[at]) * ratio);
        }
    }
    if (!(turning > STILL * largest))
        return 0;
    return slow_ones(step->mean, step->slow, w->count, n, w->scale, h, step->changes);
}

/* Collocate the leading tangents over the step; the faster ones turn with them, and keep the growth
 * from the exponential. */
static void collocate_leading(const System *s, const Walk *w, double t, double h, int leading,
                              double *growth, Step *step)
{
    const int n = s->states;
    double widest = 0.0;
    for (int j = 0; j < leading; j++) {
        widest = larger(widest, step->changes[j]);
        growth[j] = step->logs[j];
    }
    const int parts = (int)larger(1.0, ceil(widest / SLOW));
    for (int part = 0; part < parts; part++) {
        for (int stage = 0; stage < 3; stage++) {
            const double q = (part + RADAU_NODES[stage]) / parts;
            if (q == 1.0) {
                memcpy(step->radau + stage * n * n, step->at_end, (size_t)(n * n) * sizeof(double));
                continue;
            }
            place(step, n, q, h);
            s->jac(s, t + q * h, step->at, w->u, w->p, step->radau + stage * n * n,
                   step->by_time);
        }
        collocate(step->radau, h / parts, step->slow, leading, n, &step->propagation);
    }
    memcpy(w->frame, step->slow, (size_t)(leading * n) * sizeof(double));
    for (int j = leading; j < w->count; j++)
        step->logs[j] = growth[j];
    orthonormalize(w->frame, w->count, n, growth);
    for (int j = leading; j < w->count; j++)
        growth[j] = step->logs[j];
}

/* Move the tangents over an accepted step. */
static void move_tangents(const System *s, const Walk *w, double t, double h, double *growth,
                          double *trace, Step *step)
{
    const int n = s->states;
    for (int i = 0; i < n; i++)
        *trace += h * step->mean[i * n + i];
    memcpy(step->logs, growth, (size_t)w->count * sizeof(double));
    memcpy(step->slow, w->frame, (size_t)(w->count * n) * sizeof(double));
    const int leading = how_many_slow(w, n, h, step);
    if (leading < w->count) {
        for (int part = 0; part < 2; part++) {
            const double a = part == 0 ? HEAVY : LIGHT, b = part == 0 ? LIGHT : HEAVY;
            for (int at = 0; at < n * n; at++)
                step->omega[at] = h * (a * step->j1[at] + b * step->j2[at]);
            const double met = push(step->omega, w->frame, w->count, n, growth, w->scale,
                                    0.75 * step->rate * h, &step->propagation);
            step->rate = 2.0 * met / h;
        }
    }
    if (leading > 0)
        collocate_leading(s, w, t, h, leading, growth, step);
}

static int diverged(const double *x, const double *bound, int n)
{
    for (int i = 0; i < n; i++) {
        if (!(fabs(x[i]) <= bound[i]))
            return 1;
    }
    return 0;
}

/* Follow state and tangents from t to `goal`, within a row of the grid; return DONE, or why not. */
static int follow_span(const System *s, const Walk *w, int row, double t, double goal, Work *work,
                       Info *info, Step *step)
{
    const int n = s->states;
    const size_t size = (size_t)n * sizeof(double);
    const double tolerance = TOLERANCE * pow(w->rtol, ORDER);
    double *const x = w->states + row * n, *const growth = w->growth + row * w->count;
    double *const trace = w->trace + row;
    double *const mode = s->events > 0 ? w->u + s->held - 1 : NULL;
    Note *const note = work->note;
    double until = goal;
    if (note) {
        /* events that are due because an input jumped happen now, for any state */
        note->any = 0;
        if (settle(s, t, x, w->u, w->p, work, info) != DONE)
            return CHATTER;
        if (note->any)
            *trace += jump(s, t, w, x, growth, note, 0, step);
    }
    int taken = 0;
    work->known = 0;
    while (t < goal) {
        memcpy(step->first, x, size);
        const double mode_before = mode ? *mode : 0.0;
        if (note)
            note->any = 0;
        const double accepted = info->accepted;
        const int status =
            integrate(s, t, until, x, w->u, w->p, w->atol, w->rtol, work, info, 1);
        if (status != DONE && status != TOO_MANY_STEPS)
            return status;
        if (++taken > w->max_steps)
            return TOO_MANY_STEPS;
        if (diverged(x, w->bound, n))
            return DIVERGED;
        work->known = !note; /* only steps have changed the state or will change it */
        if (info->accepted == accepted)
            continue;
        const double h = info->reached - t;
        if (h > 0.0) {
            /* the state before any event, which the stepper's memory still holds */
            memcpy(step->last, work->stage, size);
            const double mode_after = mode ? *mode : 0.0;
            if (mode)
                *mode = mode_before;
            const double apart = look_at_step(s, w, t, h, work, step);
            if (apart > tolerance && h > SHORTEST * larger(fabs(t), fabs(goal))) {
                memcpy(x, step->first, size);
                until = t + 0.5 * h;
                info->next_step = 0.5 * h;
                continue;
            }
            until = goal;
            memcpy(work->jacobian, step->at_end, size * n);
            memcpy(work->by_time, step->by_time, size);
            move_tangents(s, w, t, h, growth, trace, step);
            if (mode)
                *mode = mode_after;
        }
        t = info->reached;
        if (note && note->any)
            *trace += jump(s, t, w, x, growth, note, 1, step);
    }
    return DONE;
}

/* The first sample instant after t, or t itself if it is a sample instant and `here` is set. */
static double sample_instant(double t, double period, int here)
{
    const double count = t / period, nearest = rint(count);
    const int at_one = fabs(count - nearest) <= SAME_INSTANT;
    if (at_one)
        return here ? t : (nearest + 1.0) * period;
    return ceil(count) * period;
}

/* Follow state and tangents over one row of the grid; return DONE, or why not. A sample at the
 * row's end belongs to the next row. */
static int follow_row(const System *s, const Walk *w, int row, Work *work, Info *info, Step *step)
{
    const double goal = w->times[row];
    double t = w->times[row - 1];
    if (!(w->period > 0.0))
        return follow_span(s, w, row, t, goal, work, info, step);
    double *const x = w->states + row * s->states, *const growth = w->growth + row * w->count;
    while (t < goal) {
        if (sample_instant(t, w->period, 1) == t) {
            work->note->any = 0;
            note_event(s, t, x, w->u, w->p, SAMPLE, work->note);
            s->react(s, t, x, w->u, w->p, SAMPLE);
            w->trace[row] += jump(s, t, w, x, growth, work->note, 0, step);
        }
        double end = sample_instant(t, w->period, 0);
        if (end > goal || goal - end <= SAME_INSTANT * w->period)
            end = goal;
        const int status = follow_span(s, w, row, t, end, work, info, step);
        if (status != DONE)
            return status;
        t = end;
    }
    return DONE;
}

/* Follow the first state and its tangents over the grid. Returns the number of rows that were
 * reached; info->status has the reason of the end, and info->reached its time. */
static int spectrum(const System *s, const Walk *w, Info *info)
{
    const int n = s->states;
    const size_t work_size = WORK_DOUBLES(n, s->events);
    double *const memory =
        malloc((work_size + STEP_DOUBLES(n) + NOTE_DOUBLES(n)) * sizeof(double));
    if (!memory) {
        info->status = NO_MEMORY;
        return 0;
    }
    Work work;
    Step step;
    Note note;
    lay_work(&work, n, s->events, memory);
    lay_step(&step, n, memory + work_size);
    lay_note(&note, n, memory + work_size + STEP_DOUBLES(n));
    if (s->events > 0)
        work.note = &note;
    int row = 1;
    info->status = DONE;
    for (; row < w->rows && info->status == DONE; row++) {
        memcpy(w->states + row * n, w->states + (row - 1) * n, (size_t)n * sizeof(double));
        memcpy(w->growth + row * w->count, w->growth + (row - 1) * w->count,
               (size_t)w->count * sizeof(double));
        w->trace[row] = w->trace[row - 1];
        info->status = follow_row(s, w, row, &work, info, &step);
    }
    free(memory);
    return info->status == DONE ? row : row - 1;
}
