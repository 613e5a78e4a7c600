/* The stiff stepper: Rodas5P (G. Steinebach, BIT Numer. Math. 63, 27 (2023)), eight stages, order
 * five with an embedded fourth-order solution, L-stable, with analytic Jacobian. It is the project's
 * solver/stepper.py, operation by operation, so that both give the same numbers. Expects from the
 * generated equations: N, EVENTS, rhs, jac, indicate, kind, react. */
#ifndef STEPPER_H
#define STEPPER_H

#include <math.h>
#include <string.h>

#include "arithmetic.h"

#define STAGES 8
#define GAMMA 0.21193756319429014

enum { DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, CHATTER };
enum { NEXT_STEP, ACCEPTED, REJECTED, REACHED, EVENT_COUNT, STATUS, LAST_ERROR, INFO_SIZE };
enum { EITHER, CHANGES_MODE, RESETS };

#define MOST_AT_ONCE 64 /* events at one instant */
#define INSIDE 4        /* parts of a step at whose ends a crossing is looked for */
#define MAX_STEPS 200000

#define A6 -7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, \
           0.030198172008377946

static const double A[STAGES][STAGES] = {
    {0.0},
    {3.0},
    {2.849394379747939, 0.45842242204463923},
    {-6.954028509809101, 2.489845061869568, -10.358996098473584},
    {2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641},
    {A6},
    {A6, 1.0},
    {A6, 1.0, 1.0},
};
static const double C[STAGES][STAGES] = {
    {0.0},
    {-14.155112264123755},
    {-17.97296035885952, -2.859693295451294},
    {147.12150275711716, -1.41221402718213, 71.68940251302358},
    {165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306},
    {24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125,
     -0.6610691825249471},
    {30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783,
     -19.097331116725623, -28.087943162872662},
    {37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047,
     -40.06618937091002, -54.66780262877968, -9.48861652309627},
};
static const double NODES[STAGES] = {
    0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664,
    1.0, 1.0, 1.0,
};
/* weights of the partial derivative by time */
static const double BY_TIME[STAGES] = {
    GAMMA, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069,
    0.0, 0.0, 0.0,
};

/* Scratch memory; contents do not matter between calls. */
typedef struct {
    double jacobian[AT_LEAST_1(N * N)];
    double w[AT_LEAST_1(N * N)];
    double k[STAGES][AT_LEAST_1(N)];
    double stage[AT_LEAST_1(N)];
    double slope[AT_LEAST_1(N)];
    double by_time[AT_LEAST_1(N)];
    double alone[AT_LEAST_1(N)];
    double end[AT_LEAST_1(N)];
    double first[AT_LEAST_1(N)];
    double middle[AT_LEAST_1(N)];
    double g[AT_LEAST_1(EVENTS)];
    double before[AT_LEAST_1(EVENTS)];
    int pivots[AT_LEAST_1(N)];
    int found;
} Work;

/* Who is told of every accepted step: of its time t and of the time t1 where the integration is to
 * end. The answer is where it shall end, t at the earliest. The states are to be looked at only. */
typedef struct {
    double (*end)(void *owner, double t, double t1);
    void *owner;
} Watcher;

/* Replace w by its LU factors with row pivoting; 0 if it is singular. */
static int factorize(double *w, int *pivots)
{
    for (int k = 0; k < N; k++) {
        double best = fabs(w[k * N + k]);
        int row = k;
        for (int i = k + 1; i < N; i++) {
            if (fabs(w[i * N + k]) > best) {
                best = fabs(w[i * N + k]);
                row = i;
            }
        }
        if (!(best > 0.0) || best == HUGE_VAL)
            return 0;
        pivots[k] = row;
        if (row != k) {
            for (int j = 0; j < N; j++) {
                const double swapped = w[k * N + j];
                w[k * N + j] = w[row * N + j];
                w[row * N + j] = swapped;
            }
        }
        const double inverse = 1.0 / w[k * N + k];
        for (int i = k + 1; i < N; i++) {
            const double factor = w[i * N + k] *= inverse;
            if (factor != 0.0) {
                for (int j = k + 1; j < N; j++)
                    w[i * N + j] -= factor * w[k * N + j];
            }
        }
    }
    return 1;
}

static void solve_factorized(const double *w, const int *pivots, double *b)
{
    for (int k = 0; k < N; k++) {
        const double swapped = b[k];
        b[k] = b[pivots[k]];
        b[pivots[k]] = swapped;
    }
    for (int k = 0; k < N; k++) {
        for (int i = k + 1; i < N; i++)
            b[i] -= w[i * N + k] * b[k];
    }
    for (int k = N - 1; k >= 0; k--) {
        for (int j = k + 1; j < N; j++)
            b[k] -= w[k * N + j] * b[j];
        b[k] /= w[k * N + k];
    }
}

/* One step from x, with the Jacobian in `work`; the new state goes to work->stage. Returns the error
 * estimate in units of the tolerance, infinity where there is no step. */
static double attempt(double t, double h, const double *x, const double *u, const double *p,
                      const double *atol, double rtol, Work *work)
{
    const double diagonal = 1.0 / (GAMMA * h);
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++)
            work->w[i * N + j] = -work->jacobian[i * N + j];
        work->w[i * N + i] += diagonal;
    }
    if (!factorize(work->w, work->pivots))
        return HUGE_VAL;
    for (int s = 0; s < STAGES; s++) {
        for (int i = 0; i < N; i++) {
            double value = x[i];
            for (int j = 0; j < s; j++)
                value += A[s][j] * work->k[j][i];
            work->stage[i] = value;
        }
        rhs(t + NODES[s] * h, work->stage, u, p, work->slope);
        for (int i = 0; i < N; i++) {
            double value = work->slope[i] + h * BY_TIME[s] * work->by_time[i];
            for (int j = 0; j < s; j++)
                value += C[s][j] / h * work->k[j][i];
            work->k[s][i] = value;
            work->slope[i] = value;
        }
        solve_factorized(work->w, work->pivots, work->k[s]);
        for (int i = 0; i < N; i++) {
            if (work->alone[i] > 0.0)
                work->k[s][i] = work->slope[i] * GAMMA * h;
        }
    }
    double total = 0.0;
    for (int i = 0; i < N; i++) {
        work->stage[i] += work->k[STAGES - 1][i];
        const double scale = atol[i] + rtol * larger(fabs(x[i]), fabs(work->stage[i]));
        const double share = work->k[STAGES - 1][i] / scale;
        total += share * share;
    }
    return sqrt(total / AT_LEAST_1(N));
}

/* Let every event happen that is due at this instant; DONE or CHATTER. */
static int settle(double t, double *x, double *u, const double *p, Work *work, double *info)
{
    int fired[AT_LEAST_1(EVENTS)] = {0};
    if (EVENTS == 0)
        return DONE;
    for (int round = 0; round < MOST_AT_ONCE; round++) {
        int due = -1;
        indicate(t, x, u, p, work->g);
        for (int k = 0; k < EVENTS && due < 0; k++) {
            const int what = kind(u, k);
            if (work->g[k] > 0.0 && what != EITHER && !(what == RESETS && fired[k]))
                due = k;
        }
        if (due < 0)
            return DONE;
        if (kind(u, due) == RESETS)
            fired[due] = 1;
        else
            memset(fired, 0, sizeof fired);
        react(t, x, u, p, due);
        info[EVENT_COUNT] += 1;
    }
    info[REACHED] = t;
    return CHATTER;
}

/* The event whose indicator is furthest past zero and was not before; -1 if there is none. */
static int due_at(double t, const double *x, const double *u, const double *p, Work *work)
{
    double best = 0.0;
    int found = -1;
    indicate(t, x, u, p, work->g);
    for (int k = 0; k < EVENTS; k++) {
        const int what = kind(u, k);
        double past = what == EITHER ? -work->g[k] * work->before[k] : work->g[k];
        if (what != EITHER && work->before[k] > 0.0)
            past = 0.0;
        if (past > best) {
            best = past;
            found = k;
        }
    }
    return found;
}

/* Keep the indicators' signs at the start of a step. */
static void look_before(double t, const double *x, const double *u, const double *p, double *before)
{
    indicate(t, x, u, p, before);
    for (int k = 0; k < EVENTS; k++) {
        if (kind(u, k) == EITHER)
            before[k] = before[k] > 0.0 ? 1.0 : (before[k] < 0.0 ? -1.0 : 0.0);
    }
}

/* Length of the part of a step that ends at its first event, h if there is none; the state at its
 * end goes to work->stage. */
static double locate(double t, double h, const double *x, const double *u, const double *p,
                     const double *atol, double rtol, Work *work)
{
    look_before(t, x, u, p, work->before);
    /* Hermite's cubic through both ends shows crossings that come and go within the step. */
    memcpy(work->end, work->stage, sizeof work->end);
    rhs(t, x, u, p, work->first);
    rhs(t + h, work->end, u, p, work->slope);
    double high = -1.0;
    for (int part = 1; part < INSIDE; part++) {
        const double s = (double)part / INSIDE;
        for (int i = 0; i < N; i++) {
            work->middle[i] = (1.0 + 2.0 * s) * ((1.0 - s) * (1.0 - s)) * x[i] +
                              s * ((1.0 - s) * (1.0 - s)) * h * work->first[i] +
                              s * s * (3.0 - 2.0 * s) * work->end[i] +
                              s * s * (s - 1.0) * h * work->slope[i];
        }
        if (due_at(t + s * h, work->middle, u, p, work) >= 0) {
            attempt(t, s * h, x, u, p, atol, rtol, work);
            if (due_at(t + s * h, work->stage, u, p, work) >= 0) {
                high = s * h;
                break;
            }
        }
    }
    if (high < 0.0) {
        if (due_at(t + h, work->end, u, p, work) < 0) {
            memcpy(work->stage, work->end, sizeof work->stage);
            work->found = -1;
            return h;
        }
        high = h;
    }
    double low = 0.0;
    while (high - low > 2.3e-16 * larger(fabs(t), high)) {
        const double half = 0.5 * (low + high);
        if (!(low < half && half < high))
            break;
        attempt(t, half, x, u, p, atol, rtol, work);
        if (due_at(t + half, work->stage, u, p, work) >= 0)
            high = half;
        else
            low = half;
    }
    attempt(t, high, x, u, p, atol, rtol, work);
    work->found = due_at(t + high, work->stage, u, p, work);
    if (work->found >= 0 && kind(u, work->found) == RESETS) {
        high = low;
        if (low > 0.0)
            attempt(t, low, x, u, p, atol, rtol, work);
        else
            memcpy(work->stage, x, sizeof work->stage);
    }
    return high;
}

/* Advance dx/dt = rhs(t, x, u, p) from t0 to t1 with u and p held, in place; less far if a watcher
 * says so. */
static int integrate(double t0, double t1, double *x, double *u, const double *p,
                     const double *atol, double rtol, Work *work, double *info,
                     const Watcher *watcher)
{
    if (EVENTS > 0 && settle(t0, x, u, p, work, info) != DONE)
        return CHATTER;
    info[REACHED] = t1;
    const double span = t1 - t0;
    if (span == 0.0)
        return DONE;
    if (N == 0) {
        if (watcher)
            watcher->end(watcher->owner, t1, t1);
        return DONE;
    }
    double h = info[NEXT_STEP];
    if (!(h > 0.0) || h > span)
        h = span;
    const double smallest = 1e-13 * larger(larger(fabs(t0), fabs(t1)), span);
    double t = t0;
    double last_error = info[LAST_ERROR] > 0.0 ? info[LAST_ERROR] : 1e-4;
    info[LAST_ERROR] = 0.0;
    int fresh = 1; /* the Jacobian belongs to the present point */
    int rejected_before = 0;
    int still = 0; /* events since time last moved on */
    for (int count = 0; count < MAX_STEPS; count++) {
        const double remaining = t1 - t;
        if (h < smallest && h < remaining) {
            info[NEXT_STEP] = h;
            info[REACHED] = t;
            return STEP_TOO_SMALL;
        }
        /* A last step of a sliver would cost as much as a whole one: stretch or halve instead. */
        int final = 0;
        const double planned = h;
        if (h >= remaining * 0.99999) {
            h = remaining;
            final = 1;
        } else if (h > 0.6 * remaining) {
            h = 0.5 * remaining;
        }
        if (fresh) {
            jac(t, x, u, p, work->jacobian, work->by_time);
            fresh = 0;
            /* A state that depends on none is free of the others' round-off. */
            for (int i = 0; i < N; i++) {
                work->alone[i] = 1.0;
                for (int j = 0; j < N; j++) {
                    if (work->jacobian[i * N + j] != 0.0)
                        work->alone[i] = 0.0;
                }
            }
        }
        double error = attempt(t, h, x, u, p, atol, rtol, work);
        if (error <= 1.0) { /* false for NaN, too */
            double taken = h;
            work->found = -1;
            if (EVENTS > 0)
                taken = locate(t, h, x, u, p, atol, rtol, work);
            memcpy(x, work->stage, N * sizeof *x);
            info[ACCEPTED] += 1;
            fresh = 1;
            if (work->found >= 0) {
                const double before = t;
                t = final && taken == h ? t1 : t + taken;
                still = t > before ? 0 : still + 1;
                react(t, x, u, p, work->found);
                info[EVENT_COUNT] += 1;
                if (still > MOST_AT_ONCE || settle(t, x, u, p, work, info) != DONE) {
                    info[REACHED] = t;
                    return CHATTER;
                }
                h = planned;
                last_error = 1e-4;
                rejected_before = 0;
                if (watcher)
                    info[REACHED] = t1 = watcher->end(watcher->owner, t, t1);
                if (t >= t1) {
                    info[NEXT_STEP] = h;
                    return DONE;
                }
                continue;
            }
            t = final ? t1 : t + h;
            error = larger(error, 1e-10);
            /* proportional-integral control (Gustafsson) keeps rejections rare */
            double growth = 0.9 * pow(error, -0.17) * pow(last_error, 0.06);
            growth = smaller(6.0, larger(0.2, growth));
            if (rejected_before)
                growth = smaller(growth, 1.0);
            last_error = larger(error, 1e-4);
            rejected_before = 0;
            if (watcher)
                info[REACHED] = t1 = watcher->end(watcher->owner, t, t1);
            if (t >= t1) {
                info[NEXT_STEP] = growth >= 1.0 ? larger(planned, h * growth) : h * growth;
                return DONE;
            }
            h *= growth;
        } else {
            info[REJECTED] += 1;
            rejected_before = 1;
            h *= error < HUGE_VAL ? larger(0.1, 0.9 * pow(error, -0.2)) : 0.1;
        }
    }
    info[NEXT_STEP] = h;
    info[REACHED] = t;
    info[LAST_ERROR] = last_error;
    return TOO_MANY_STEPS;
}

#endif
