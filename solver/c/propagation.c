/* Tangent vectors pushed by a matrix exponential or by collocation, and orthonormalized. */
#include "factorize.h"
#include "orthonormalize.h"

#define SLOW 0.3     /* largest change of a slow tangent in a part of a step, over its length */
#define MOST_PARTS 4 /* of a step in which slow tangents are collocated */

#define PROPAGATION_DOUBLES(n) (14 * (n) * (n) + 14 * (n) + 2)

/* Scratch memory of PROPAGATION_DOUBLES(n). */
typedef struct {
    double *e, *saved, *saved_logs, *row;
    double *power, *other, *below, *column;
    double *matrix, *stages; /* 3 n x 3 n, 3 n; shared with those above */
    int32_t *pivots;         /* 3 n */
} Propagation;

#define SMALL 0.5        /* norm up to which the approximant is exact to the last digit */
#define SPREAD 16.0      /* most nats between first and last tangent in one orthonormalization */
#define FARTHEST 300.0   /* most nats of one exponential: the square of the result is in range */
#define TOO_WIDE 25.0    /* nats: with more, important digits are lost, and it is done again */
#define ROOT_6 2.4494897427831781

/* of exp, six over six */
static const double PADE[] = {1.0, 1.0 / 2, 5.0 / 44, 1.0 / 66, 1.0 / 792, 1.0 / 15840,
                              1.0 / 665280};
static const double RADAU[3][3] = {
    {(88 - 7 * ROOT_6) / 360, (296 - 169 * ROOT_6) / 1800, (-2 + 3 * ROOT_6) / 225},
    {(296 + 169 * ROOT_6) / 1800, (88 + 7 * ROOT_6) / 360, (-2 - 3 * ROOT_6) / 225},
    {(16 - ROOT_6) / 36, (16 + ROOT_6) / 36, 1.0 / 9},
};
static const double RADAU_NODES[3] = {(4 - ROOT_6) / 10, (4 + ROOT_6) / 10, 1.0};

static void lay_propagation(Propagation *own, int n, double *next)
{
    TAKE(e, n * n), TAKE(saved, n * n), TAKE(saved_logs, n), TAKE(row, n);
    own->power = next;
    own->other = own->power + n * n;
    own->below = own->other + n * n;
    own->column = own->below + n * n;
    TAKE(matrix, 9 * n * n), TAKE(stages, 3 * n), TAKE(pivots, 0);
}

/* Solve the linear equation for the first `count` tangents over a step, in place: Radau IIA of
 * three stages (e.g. E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Springer
 * 1996, Section IV.5), as one linear system. `jacobians`, 3 x n x n, are at RADAU_NODES of the
 * step. */
static void collocate(const double *jacobians, double h, double *frame, int count, int n,
               const Propagation *work)
{
    const int size = 3 * n;
    double *const matrix = work->matrix, *const stages = work->stages;
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b < 3; b++) {
            const double weight = h * RADAU[a][b];
            for (int i = 0; i < n; i++) {
                for (int j = 0; j < n; j++)
                    matrix[(a * n + i) * size + b * n + j] =
                        -weight * jacobians[(b * n + i) * n + j];
            }
        }
        for (int i = 0; i < n; i++)
            matrix[(a * n + i) * size + a * n + i] += 1.0;
    }
    factorize(matrix, work->pivots, size);
    for (int k = 0; k < count; k++) {
        for (int a = 0; a < 3; a++)
            memcpy(stages + a * n, frame + k * n, (size_t)n * sizeof *frame);
        solve_factorized(matrix, work->pivots, size, stages);
        memcpy(frame + k * n, stages + 2 * n, (size_t)n * sizeof *frame);
    }
}

/* Number of the first tangents that are slow; also their changes in a step of h, over their
 * lengths. */
static int slow_ones(const double *jacobian, const double *frame, int count, int n, const double *scale,
              double h, double *changes)
{
    for (int k = 0; k < count; k++) {
        const double *const tangent = frame + k * n;
        double length = 0.0, change = 0.0;
        for (int i = 0; i < n; i++) {
            double rate = 0.0;
            for (int j = 0; j < n; j++)
                rate += jacobian[i * n + j] * tangent[j];
            const double moved = h * rate / scale[i], own = tangent[i] / scale[i];
            change += moved * moved;
            length += own * own;
        }
        changes[k] = sqrt(change / length);
        if (!(changes[k] <= SLOW * MOST_PARTS))
            return k;
    }
    return count;
}

static void multiply(const double *a, const double *b, double *c, int n)
{
    memset(c, 0, (size_t)(n * n) * sizeof *c);
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < n; k++) {
            const double factor = a[i * n + k];
            if (factor != 0.0) {
                for (int j = 0; j < n; j++)
                    c[i * n + j] += factor * b[k * n + j];
            }
        }
    }
}

/* Write exp(a) to e for a matrix of norm at most SMALL; a is not changed. */
static void exponential(const double *a, double *e, int n, const Propagation *work)
{
    double *const power = work->power, *const other = work->other, *const below = work->below;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            const int at = i * n + j;
            const double unit = i == j ? 1.0 : 0.0;
            power[at] = a[at];
            e[at] = unit + PADE[1] * a[at];
            below[at] = unit - PADE[1] * a[at];
        }
    }
    double sign = 1.0;
    for (int k = 2; k < 7; k++) {
        multiply(power, a, other, n);
        for (int at = 0; at < n * n; at++) {
            power[at] = other[at];
            e[at] += PADE[k] * other[at];
            below[at] += sign * PADE[k] * other[at];
        }
        sign = -sign;
    }
    factorize(below, work->pivots, n);
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++)
            work->column[i] = e[i * n + j];
        solve_factorized(below, work->pivots, n, work->column);
        for (int i = 0; i < n; i++)
            e[i * n + j] = work->column[i];
    }
}

/* Multiply every row of `frame`, as a column, by `matrix`, in place. */
static void apply(const double *matrix, double *frame, int count, int n, double *row)
{
    for (int j = 0; j < count; j++) {
        double *const own = frame + j * n;
        for (int i = 0; i < n; i++) {
            double total = 0.0;
            for (int k = 0; k < n; k++)
                total += matrix[i * n + k] * own[k];
            row[i] = total;
        }
        memcpy(own, row, (size_t)n * sizeof *own);
    }
}

/* Apply exp(omega) to the tangents, with as many orthonormalizations as their spread needs; omega
 * is overwritten. `spread` are the expected nats between first and last tangent, not positive if
 * not known. Returns the nats that were found. */
static double push(double *omega, double *frame, int count, int n, double *logs, const double *scale,
            double spread, const Propagation *work)
{
    double *const e = work->e;
    const size_t rows = (size_t)(count * n) * sizeof *frame;
    /* In units near the states' own, the norm is of the size of the fastest rate. */
    double norm = 0.0;
    for (int j = 0; j < n; j++) {
        double total = 0.0;
        for (int i = 0; i < n; i++) {
            omega[i * n + j] *= scale[j] / scale[i];
            total += fabs(omega[i * n + j]);
        }
        norm = total != total ? total : larger(norm, total);
        if (norm != norm)
            break;
    }
    if (!(norm < HUGE_VAL)) {
        for (int j = 0; j < count; j++)
            logs[j] = NAN;
        return 0.0;
    }
    const double whole = norm;
    int halvings = 0;
    while (norm > SMALL) {
        norm *= 0.5;
        halvings++;
    }
    const double factor = ldexp(1.0, -halvings);
    for (int at = 0; at < n * n; at++)
        omega[at] *= factor;
    if (count == 1)
        spread = 0.0; /* nothing to be orthogonal to */
    else if (!(spread > 0.0))
        spread = whole;
    memcpy(work->saved_logs, logs, (size_t)count * sizeof *logs);
    memcpy(work->saved, frame, rows);
    double found = 0.0;
    for (int round = 0; round < 60; round++) {
        exponential(omega, e, n, work);
        int parts = halvings;
        while (parts > 0 &&
               ldexp(larger(spread, whole * SPREAD / FARTHEST), 1 - parts) <= SPREAD) {
            multiply(e, e, work->power, n);
            memcpy(e, work->power, (size_t)(n * n) * sizeof *e);
            parts--;
        }
        for (int i = 0; i < n; i++) {
            for (int j = 0; j < n; j++)
                e[i * n + j] *= scale[i] / scale[j];
        }
        double widest = 0.0;
        found = 0.0;
        for (double part = 0.0; part < ldexp(1.0, parts); part += 1.0) {
            apply(e, frame, count, n, work->row);
            const double met = orthonormalize(frame, count, n, logs);
            widest = larger(widest, met);
            found += met;
        }
        if (widest <= TOO_WIDE || parts == halvings)
            return found;
        spread = 2.0 * larger(spread, ldexp(widest, parts));
        memcpy(logs, work->saved_logs, (size_t)count * sizeof *logs);
        memcpy(frame, work->saved, rows);
    }
    return found;
}
