#include "stepper.h"

#define GAMMA 0.21193756319429014
#define FEW 6    /* states: matrices of so few hardly have zeros to use */
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

/* of the dense output, of order four */
static const double WITHIN[3][STAGES] = {
    {25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
     0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493},
    {-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
     20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372},
    {11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
     -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722},
};

/* Divide an array of WORK_DOUBLES(states, events) into scratch memory. */
static void lay_work(Work *own, int n, int events, double *next)
{
    TAKE(jacobian, n * n), TAKE(w, n * n), TAKE(sparse.lower, 2 * n * n), TAKE(k, STAGES * n);
    TAKE(stage, n), TAKE(slope, n), TAKE(by_time, n), TAKE(alone, n), TAKE(end, n);
    TAKE(first, n), TAKE(middle, n), TAKE(g, events), TAKE(before, events), TAKE(left, n);
    TAKE(sparse.inverse, n), TAKE(pivots, 0);
    own->sparse.rows = own->pivots;
    own->sparse.counts = own->pivots + n;
    own->sparse.below = own->sparse.counts + n;
    own->fired = own->sparse.below + n;
    own->found = -1;
    own->known = 0;
    own->note = NULL;
}

/* The state at the share q of the step that was attempted last, from x. */
static void dense_output(int n, double q, const double *x, const Work *work, double *at)
{
    for (int i = 0; i < n; i++) {
        double bends[3];
        for (int order = 0; order < 3; order++) {
            bends[order] = 0.0;
            for (int r = 0; r < STAGES; r++)
                bends[order] += WITHIN[order][r] * work->k[r * n + i];
        }
        at[i] = (1.0 - q) * x[i] +
                q * (work->stage[i] + (1.0 - q) * (bends[0] + q * (bends[1] + q * bends[2])));
    }
}

#include "delays.c"

/* As `attempt`, for n states. */
INLINED double attempt_of(const System *s, double t, double h, const double *x, const double *u,
                          const double *p, const double *atol, double rtol, Work *work, const int n)
{
    const int sparse = n > FEW;
    const double diagonal = 1.0 / (GAMMA * h), per_time = 1.0 / h;
    double *const stage = work->stage;
    for (int i = 0; i < n * n; i++)
        work->w[i] = -work->jacobian[i];
    for (int i = 0; i < n; i++)
        work->w[i * n + i] += diagonal;
    if (!(sparse ? factorize_sparse(work->w, &work->sparse, n)
                 : factorize(work->w, work->pivots, n)))
        return HUGE_VAL;
    for (int r = 0; r < STAGES; r++) {
        double *const now = work->k + r * n;
        memcpy(stage, x, (size_t)n * sizeof *x);
        for (int j = 0; j < r; j++) {
            const double weight = A[r][j];
            const double *const k = work->k + j * n;
            for (int i = 0; i < n; i++)
                stage[i] += weight * k[i];
        }
        s->rhs(s, t + NODES[r] * h, stage, u, p, work->slope);
        if (r == 0)
            memcpy(work->first, work->slope, (size_t)n * sizeof *stage);
        for (int i = 0; i < n; i++)
            now[i] = work->slope[i] + h * BY_TIME[r] * work->by_time[i];
        for (int j = 0; j < r; j++) {
            const double weight = C[r][j] * per_time;
            const double *const k = work->k + j * n;
            for (int i = 0; i < n; i++)
                now[i] += weight * k[i];
        }
        memcpy(work->slope, now, (size_t)n * sizeof *now);
        if (sparse) {
            memcpy(work->left, now, (size_t)n * sizeof *now);
            solve_sparse(&work->sparse, n, work->left, now);
        } else {
            solve_factorized(work->w, work->pivots, n, now);
        }
        for (int i = 0; i < n; i++) {
            if (work->alone[i] > 0.0)
                now[i] = work->slope[i] * GAMMA * h;
        }
    }
    const double *const last = work->k + (STAGES - 1) * n;
    double total = 0.0;
    for (int i = 0; i < n; i++) {
        stage[i] += last[i];
        const double scale = atol[i] + rtol * larger(fabs(x[i]), fabs(stage[i]));
        const double share = last[i] / scale;
        total += share * share;
    }
    return sqrt(total / (n > 0 ? n : 1));
}

/* One step from x, with the Jacobian in `work`; the new state goes to work->stage. Returns the error
 * estimate in units of the tolerance; infinity if the step fails. */
static double attempt(const System *s, double t, double h, const double *x, const double *u,
                      const double *p, const double *atol, double rtol, Work *work)
{
    UNROLLED(attempt_of, s->states, s, t, h, x, u, p, atol, rtol, work)
}

#include "events.c"

/* Find states that depend on no state, such as one held at rest: others add no round-off. */
static void find_alone(int n, Work *work)
{
    for (int i = 0; i < n; i++) {
        int j = 0;
        while (j < n && work->jacobian[i * n + j] == 0.0)
            j++;
        work->alone[i] = j == n;
    }
}

/* Advance dx/dt = f(t, x, u, p) from t0 to t1 with u and p held, in place. At most max_steps steps
 * are taken, accepted or rejected. */
static int integrate(const System *s, double t0, double t1, double *x, double *u, const double *p,
              const double *atol, double rtol, Work *work, Info *info, int max_steps)
{
    const int n = s->states;
    info->reached = t0;
    if (s->delays && !begin_history(s, t0, x, u, p))
        return NO_DELAY;
    if (s->events > 0 && settle(s, t0, x, u, p, work, info) != DONE)
        return CHATTER;
    info->reached = t1;
    const double span = t1 - t0;
    if (span == 0.0)
        return DONE;
    if (n == 0 && !s->delays)
        return DONE;
    const double smallest = SMALLEST * larger(larger(fabs(t0), fabs(t1)), span);
    double h = info->next_step;
    if (!(h > smallest) || h > span) /* the previous step may have been tiny */
        h = span;
    double t = t0;
    double last_error = info->last_error > 0.0 ? info->last_error : 1e-4;
    info->last_error = 0.0;
    int fresh = 1; /* the Jacobian belongs to the present point */
    int rejected_before = 0;
    Crowd crowd = {-HUGE_VAL, 0};
    for (int count = 0; count < max_steps; count++) {
        if (s->delays && !has_room(s)) {
            info->next_step = h;
            info->reached = t;
            info->last_error = last_error;
            return NO_ROOM;
        }
        const double goal = s->delays ? latest_end(s, t, t1) : t1;
        const double remaining = goal - t;
        if (h < smallest && h < remaining) {
            info->next_step = h;
            info->reached = t;
            return STEP_TOO_SMALL;
        }
        /* A tiny last step would cost as much as a full one: stretch or halve instead. */
        int final = 0;
        const double planned = h;
        if (h >= remaining * 0.99999) {
            h = remaining;
            final = 1;
        } else if (h > 0.6 * remaining) {
            h = 0.5 * remaining;
        }
        if (fresh) {
            if (!work->known)
                s->jac(s, t, x, u, p, work->jacobian, work->by_time);
            fresh = work->known = 0;
            find_alone(n, work);
        }
        double error = attempt(s, t, h, x, u, p, atol, rtol, work);
        if (s->delays && error <= 1.0)
            error = larger(error, follow_signals(s, t, h, x, u, p, rtol, work));
        if (error <= 1.0) { /* false for NaN, too */
            double taken = h;
            work->found = -1;
            if (s->events > 0)
                taken = locate(s, t, h, x, u, p, atol, rtol, work);
            if (s->delays && taken > 0.0) {
                if (taken != h)
                    follow_signals(s, t, taken, x, u, p, rtol, work);
                keep_step(s, t, final && taken == h ? goal : t + taken, u);
            }
            memcpy(x, work->stage, (size_t)n * sizeof *x);
            info->accepted += 1.0;
            fresh = 1;
            if (work->found >= 0) {
                t = final && taken == h ? goal : t + taken;
                react_to(s, t, x, u, p, work->found, work, info);
                if (crowded(&crowd, t, smallest) || settle(s, t, x, u, p, work, info) != DONE) {
                    info->reached = t;
                    return CHATTER;
                }
                h = planned;
                last_error = 1e-4;
                rejected_before = 0;
                if (t >= t1) {
                    info->next_step = h;
                    return DONE;
                }
                continue;
            }
            t = final ? goal : t + h;
            error = larger(error, 1e-10);
            /* proportional-integral control (Gustafsson) keeps rejections rare */
            double growth = 0.9 * pow(error, -0.17) * pow(last_error, 0.06);
            growth = smaller(6.0, larger(0.2, growth));
            if (rejected_before)
                growth = smaller(growth, 1.0);
            last_error = larger(error, 1e-4);
            rejected_before = 0;
            if (t >= t1) {
                info->next_step = growth >= 1.0 ? larger(planned, h * growth) : h * growth;
                return DONE;
            }
            h = final && growth >= 1.0 ? larger(planned, h * growth) : h * growth;
        } else {
            info->rejected += 1.0;
            rejected_before = 1;
            h *= error < HUGE_VAL ? larger(0.1, 0.9 * pow(error, -0.2)) : 0.1;
        }
    }
    info->next_step = h;
    info->reached = t;
    info->last_error = last_error;
    return TOO_MANY_STEPS;
}
