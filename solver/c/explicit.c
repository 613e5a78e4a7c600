/* An explicit pair for systems that are not stiff: motion and tangents as one smooth system.
 *
 * The method is the eighth-order pair of Dormand and Prince with error estimates of orders five and
 * three (E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, Springer
 * 1993, Section II.10), and so is the test for steps that stability limits, not accuracy. Steps are
 * as short as motion and tangents need; the tangents are orthonormalized after each. The trace is
 * integrated together with them. If stability, or a tangent far faster than the motion, limits many
 * steps in a row, the stiff stepper is used for the motion. */
#include "tangents.h"

#define EXPLICIT_ROWS 13 /* rates of a step */

/* Scratch memory; m is n + count n, the state and its tangents in one row. */
typedef struct {
    double *k;           /* EXPLICIT_ROWS x m */
    double *at, *new;    /* m */
    double *errors;      /* 2 x m */
    double *frame;       /* count x n */
    double *jacobian;    /* n x n */
    double *by_time, *logs, *bound, *scale; /* n */
    int32_t limited, others; /* steps in a row that stability limited, and others since */
} Explicit;

#define EXPLICIT_DOUBLES(n) (17 * ((n) + (n) * (n)) + 2 * (n) * (n) + 4 * (n))

#define LIMITED 6.1   /* step times fastest rate, approximately at the limit of stability */
#define CALM 1e-8     /* share of the motion in a step's error: with less, it is no limit */
#define TELLING 1e-2  /* with a smaller error, the tolerance has not limited the step */
#define IN_A_ROW 15   /* limited steps until a motion counts as stiff */
#define FORGIVEN 6    /* other steps in a row until the limited ones are forgotten */
#define SAFETY 0.9    /* of a step's change */
#define SHRINK 0.3
#define GROW 6.0
#define LAST 12  /* the stage at the step's end */
#define FIFTH 13 /* weights of the error of order five; those of order three follow */

/* Places of the stages in the step, the last at its end. */
static const double PLACES[LAST + 1] = {
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726,
    0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571,
    1.0, 1.0,
};
/* Weights of the rates of earlier stages in each stage, and in the two errors. */
static const double WEIGHTS[FIFTH + 2][LAST] = {
    {0.0},
    {0.05260015195876773},
    {0.0197250569845379, 0.0591751709536137},
    {0.02958758547680685, 0.0, 0.08876275643042054},
    {0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792},
    {0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242},
    {0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125},
    {0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328,
     -0.015319437748624402, 0.008273789163814023},
    {0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
     20.154067550477894, -43.48988418106996},
    {0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
     15.279233632882423, -33.28821096898486, -0.020331201708508627},
    {-0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
     -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196},
    {2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
     27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
     0.6433927460157636},
    {0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
     -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034,
     0.04471061572777259},
    {0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502,
     1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571,
     -0.022355307863886294},
    {-0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
     -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034,
     0.02265179219836082},
};

static void lay_explicit(Explicit *own, int n, double *next)
{
    const int m = n + n * n; /* with the largest number of tangents */
    TAKE(k, EXPLICIT_ROWS * m), TAKE(at, m), TAKE(new, m), TAKE(errors, 2 * m), TAKE(frame, n * n);
    TAKE(jacobian, n * n), TAKE(by_time, n), TAKE(logs, n), TAKE(bound, n), TAKE(scale, n);
    own->limited = own->others = 0;
}

/* Add the rates k with the weights of a row of the table, times h, to `out`. */
static void weigh(int row, const double *k, double h, double *out, int m)
{
    for (int r = 0; r < LAST; r++) {
        const double weight = h * WEIGHTS[row][r];
        if (weight != 0.0) {
            const double *const rates = k + r * m;
            for (int i = 0; i < m; i++)
                out[i] += weight * rates[i];
        }
    }
}

/* One error from the squares of the errors of orders five and three, combined as by Hairer. */
static double mixed(double five, double three)
{
    const double both = five + 0.01 * three;
    return both > 0.0 ? five / sqrt(both) : five;
}

/* Multiply all tangents, which follow the state, by the Jacobian. */
INLINED void turn(const double *j, const double *w, double *k, int n, int m)
{
    for (int row = n; row < m; row += n) {
        for (int a = 0; a < n; a++) {
            double total = 0.0;
            for (int b = 0; b < n; b++)
                total += j[a * n + b] * w[row + b];
            k[row + a] = total;
        }
    }
}

/* Write the rates of state and tangents to k; returns the Jacobian's trace. */
INLINED double rates_at(const System *s, double t, const double *w, const double *u,
                        const double *p, const Explicit *work, double *k, int n, int m)
{
    double trace = 0.0;
    s->rhs(s, t, w, u, p, k);
    if (m > n) {
        s->jac(s, t, w, u, p, work->jacobian, work->by_time);
        turn(work->jacobian, w, k, n, m);
        for (int a = 0; a < n; a++)
            trace += work->jacobian[a * n + a];
    }
    return trace;
}

/* Error estimate of the state, and the largest of all, in units of the tolerance. A tangent's error
 * is relative to its whole length in the states' units, and to its remaining length without the
 * directions before it, of which the logarithm is needed. */
INLINED double error_of(const double *w, const Explicit *work, int n, int m, const double *atol,
                       double rtol, const double *scale, double *own)
{
    double worst = 0.0;
    for (int row = 0; row < m; row += n) {
        double a5 = 0.0, a3 = 0.0, b5 = 0.0, b3 = 0.0, length = 0.0;
        for (int i = 0; i < n; i++) {
            const double five = work->errors[row + i], three = work->errors[m + row + i];
            const double now = work->new[row + i];
            const double unit =
                row ? scale[i]
                    : sqrt((double)n) * (atol[i] + rtol * larger(fabs(w[i]), fabs(now)));
            a5 += five / unit * (five / unit);
            a3 += three / unit * (three / unit);
            length += now / unit * (now / unit);
            b5 += five * five;
            b3 += three * three;
        }
        if (row == 0) {
            *own = worst = mixed(a5, a3);
        } else {
            const double whole = mixed(a5, a3) / (rtol * sqrt(length));
            const double left = mixed(b5, b3) / (rtol * exp(work->logs[row / n - 1]));
            if (!(larger(whole, left) <= worst)) /* NaN counts as the largest */
                worst = larger(whole, left);
        }
    }
    return worst;
}

/* The data to follow: w holds the state and after it `count` tangents, a row each. */
typedef struct {
    double *w, *sums; /* the tangents' logarithms are added to sums */
    int count;
    const double *u, *p, *atol, *bound, *scale;
    double rtol;
    int max_steps;
} Stride;

/* Whether the fastest rate, or a tangent, limits this step, not the motion's accuracy. The last two
 * stages are both at the step's end: the difference of their rates over the difference of their
 * states is an estimate of the fastest rate. */
INLINED int is_limited(const Explicit *work, int n, int m, const double *scale, double h,
                      double own, double error)
{
    const double *const last = work->k + LAST * m, *const before = last - m;
    double apart = 0.0, change = 0.0;
    for (int row = 0; row < m; row += n) {
        for (int i = 0; i < n; i++) {
            const int at = row + i;
            const double a = (work->new[at] - work->at[at]) / scale[i];
            const double c = (last[at] - before[at]) / scale[i];
            apart += a * a;
            change += c * c;
        }
    }
    const int unstable = apart > 0.0 && h * h * change > LIMITED * LIMITED * apart;
    return unstable || (error > TELLING && own < CALM * error);
}

/* The first step to try: a hundredth of the time in which the state changes by its size. */
static double first_step(const double *w, const double *rates, const double *scale, int n,
                         double span)
{
    double size = 0.01, speed = 0.0;
    for (int i = 0; i < n; i++) {
        size = larger(size, fabs(w[i]) / scale[i]);
        speed = larger(speed, fabs(rates[i]) / scale[i]);
    }
    return speed > 0.0 ? 0.01 * size / speed : span;
}

/* As `stride`, for n states. */
INLINED double stride_of(const System *s, const Stride *f, double t0, double t1, Explicit *work,
                         Info *info, const int n)
{
    const int m = n + f->count * n;
    const size_t row_size = (size_t)m * sizeof(double);
    double *const w = f->w, *const k = work->k;
    info->status = DONE;
    info->reached = t1;
    const double span = t1 - t0;
    if (!(span > 0.0))
        return 0.0;
    double total = 0.0, t = t0, h = info->next_step;
    double start = rates_at(s, t, w, f->u, f->p, work, k, n, m);
    double here = start;
    if (!(h > 0.0))
        h = first_step(w, k, f->scale, n, span);
    const double smallest = 1e-13 * larger(larger(fabs(t0), fabs(t1)), span);
    int rejected = 0, status = TOO_MANY_STEPS;
    for (int round = 0; round < f->max_steps && status == TOO_MANY_STEPS; round++) {
        const double remaining = t1 - t;
        if (h < smallest && h < remaining) {
            status = STEP_TOO_SMALL;
            break;
        }
        const double planned = h;
        int final = 0;
        if (h >= remaining * 0.99999) {
            h = remaining;
            final = 1;
        } else if (h > 0.6 * remaining) {
            h = 0.5 * remaining;
        }
        double trace = 0.0;
        for (int r = 1; r <= LAST; r++) {
            double *const where = r < LAST ? work->at : work->new;
            trace += WEIGHTS[LAST][r - 1] * here;
            memcpy(where, w, row_size);
            weigh(r, k, h, where, m);
            here = rates_at(s, t + PLACES[r] * h, where, f->u, f->p, work, k + r * m, n, m);
        }
        memset(work->errors, 0, 2 * row_size);
        weigh(FIFTH, k, h, work->errors, m);
        weigh(FIFTH + 1, k, h, work->errors + m, m);
        for (int row = 0; row < f->count; row++)
            work->logs[row] = 0.0;
        memcpy(work->frame, work->new + n, row_size - (size_t)n * sizeof(double));
        if (f->count > 0)
            orthonormalize(work->frame, f->count, n, work->logs);
        double own = 0.0;
        const double error = error_of(w, work, n, m, f->atol, f->rtol, f->scale, &own);
        if (!(error <= 1.0)) { /* also NaN */
            info->rejected += 1.0;
            rejected = 1;
            h *= error < HUGE_VAL ? larger(SHRINK, SAFETY * pow(error, -0.125)) : 0.1;
            here = start;
            continue;
        }
        if (is_limited(work, n, m, f->scale, h, own, error)) {
            work->limited++;
            work->others = 0;
        } else if (++work->others >= FORGIVEN) {
            work->limited = 0;
        }
        memcpy(w, work->new, (size_t)n * sizeof(double));
        memcpy(k, k + LAST * m, (size_t)n * sizeof(double));
        for (int row = 0; row < f->count; row++)
            f->sums[row] += work->logs[row];
        memcpy(w + n, work->frame, row_size - (size_t)n * sizeof(double));
        turn(work->jacobian, w, k, n, m);
        start = here;
        total += h * trace;
        info->accepted += 1.0;
        t = final ? t1 : t + h;
        double growth = smaller(GROW, larger(SHRINK, SAFETY * pow(larger(error, 1e-12), -0.125)));
        if (rejected)
            growth = smaller(growth, 1.0);
        rejected = 0;
        if (final) {
            status = DONE;
            h = growth >= 1.0 ? larger(planned, h * growth) : h * growth;
        } else {
            h *= growth;
        }
        for (int i = 0; i < n; i++) {
            if (!(fabs(w[i]) <= f->bound[i]))
                status = DIVERGED;
        }
        if (work->limited >= IN_A_ROW && status != DIVERGED)
            status = STIFF;
    }
    info->next_step = h;
    info->reached = t;
    info->status = status;
    return total;
}

/* Advance state and tangents from t0 to t1, in place; returns the trace's integral. The status is in
 * info->status. */
static double stride(const System *s, const Stride *f, double t0, double t1, Explicit *work,
                     Info *info)
{
    UNROLLED(stride_of, s->states, s, f, t0, t1, work, info)
}

/* As `integrate`; may end with STIFF. */
static int explicitly_on(const System *s, double t0, double t1, double *x, double *u, const double *p,
                  const double *atol, double rtol, void *memory, Info *info, int max_steps)
{
    Explicit *const work = memory;
    for (int i = 0; i < s->states; i++) {
        work->bound[i] = HUGE_VAL;
        work->scale[i] = atol[i] / rtol;
    }
    const Stride f = {x, NULL, 0, u, p, atol, work->bound, work->scale, rtol, max_steps};
    stride(s, &f, t0, t1, work, info);
    return (int)info->status;
}

/* As `spectrum`, by the explicit pair. */
static int explicit_spectrum(const System *s, const Walk *walk, Info *info)
{
    const int n = s->states, count = walk->count, m = n + count * n;
    double *const memory = calloc((size_t)(EXPLICIT_DOUBLES(n) + m), sizeof(double));
    if (!memory) {
        info->status = NO_MEMORY;
        return 0;
    }
    Explicit work;
    lay_explicit(&work, n, memory);
    double *const w = memory + EXPLICIT_DOUBLES(n);
    memcpy(w, walk->states, (size_t)n * sizeof(double));
    memcpy(w + n, walk->frame, (size_t)(count * n) * sizeof(double));
    info->status = DONE;
    int row = 1;
    for (; row < walk->rows && info->status == DONE; row++) {
        double *const growth = walk->growth + row * count;
        memcpy(growth, growth - count, (size_t)count * sizeof(double));
        const Stride f = {w,           growth,      count,     walk->u,         walk->p, walk->atol,
                          walk->bound, walk->scale, walk->rtol, walk->max_steps};
        walk->trace[row] = walk->trace[row - 1] +
                           stride(s, &f, walk->times[row - 1], walk->times[row], &work, info);
        memcpy(walk->states + row * n, w, (size_t)n * sizeof(double));
    }
    memcpy(walk->frame, w + n, (size_t)(count * n) * sizeof(double));
    free(memory);
    return info->status == DONE ? row : row - 1;
}
