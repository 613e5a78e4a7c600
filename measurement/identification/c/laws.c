/* Friction laws along a given motion, see law_along_record.py; their equations come from plant/.
 * Between two samples the velocity is constant and g(v) is linear in time. Then a law of one of the
 * forms below has an exact step, which is stable for any stiffness; for all others the core solves
 * the equations. There are two sets of parameters, for motion forwards and backwards. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "laws_from_plant.h"

#define STATES 32             /* most states of any law */
API const int64_t most_states = STATES;
#define SLOW 1e-6             /* velocity for laws independent of it [m/s] */
#define MOST_STEPS 10000

/* The equations of a law without an exact step, see law_along_record.py: the core's functions, and
 * their memory. */
typedef struct {
    int (*step)(const void *instance, double t0, double t1, double tolerance, int most);
    void (*output)(const void *instance, double t);
    const void *instance;
    double *x, *v, *p, *next_step;
    const double *start, *friction;
    int64_t states;
    double tolerance;
} Equations;

/* A law with its `count` parameters by direction. */
typedef struct {
    int32_t form, count;
    const double *forwards, *backwards;
    double sharpness; /* Kv of the modified law [s/m]; 0 for abs(v) itself */
    const Equations *equations; /* NULL with an exact step */
} Law;

/* A velocity [m/s], and the law's curve there [N], which is stored because it is expensive. */
typedef struct {
    double v, curve;
} Pace;

/* A displacement d [m] in h [s], between two velocities. */
typedef struct {
    double d, h;
    Pace before, after;
} Move;

/* What differs between the forms of laws: the friction at a sample [N], the deflection after h [s]
 * of vibration at a mean speed, and that after a move; NULL if there is no such effect. */
typedef struct {
    double (*friction)(const Law *law, const double *state, Pace pace);
    void (*wear)(const Law *law, double *state, double speed, double h, double v);
    void (*move)(const Law *law, double *state, const Move *m);
} Form;

static const void *towards_side(const Law *law, double side)
{
    return side > 0.0 ? law->forwards : law->backwards;
}

static double sign_of(double v) { return v > 0.0 ? 1.0 : -1.0; }

/* The law's curve towards a side [N]; with two additional parameters, it has another bend. */
static inline double curve(const Law *law, double side, double v)
{
    const int first = FIRST_OF_CURVE[law->form];
    if (first < 0)
        return 0.0;
    const double *const q = (const double *)towards_side(law, side) + first;
    const double g = stribeck(q[0], q[1], q[2], v);
    return law->count > first + 3 ? g + stribeck(0.0, q[3], q[4], v) : g;
}

/* New value of a state that tends to `rest`. */
static inline double settled(double state, double rest, double run)
{
    return rest + (state - rest) * exp(-run);
}

/* The same if `rest` changes linearly from `begin` to `end`. */
static inline double towards(double state, double begin, double end, double run)
{
    const double gone = -expm1(-run);
    return end + (state - begin) * (1.0 - gone) - (end - begin) * gone / run;
}

/* A law's curve at both ends of a move; the same value if the direction changes in between. */
typedef struct {
    double first, last, mean;
} Curve;

static inline Curve curve_over(const Law *law, const Move *m)
{
    if (m->before.v * m->d > 0.0 && m->after.v * m->d > 0.0) {
        const double first = m->before.curve, last = m->after.curve;
        return (Curve){first, last, 0.5 * (first + last)};
    }
    const double g = curve(law, m->d, m->d / m->h);
    return (Curve){g, g, g};
}

/* ---- bristles: sigma0 depends on the direction in which they are bent ---- */

static double bristles_friction(const Law *law, const double *state, Pace pace)
{
    const double v = pace.v, z = state[0];
    const double s = law->sharpness > 0.0 ? smooth_sign(v, law->sharpness) : sign_of(v);
    return bristles_force(towards_side(law, v), towards_side(law, z), z, s, v, pace.curve);
}

static void bristles_wear(const Law *law, double *state, double speed, double h, double v)
{
    const Bristles *const q = towards_side(law, v);
    state[0] *= exp(-bristles_run(towards_side(law, state[0]), q->Fs, speed * h));
}

static void bristles_move(const Law *law, double *state, const Move *m)
{
    const Bristles *const q = towards_side(law, m->d);
    const Curve g = curve_over(law, m);
    double s = sign_of(m->d), z = state[0];
    if (law->sharpness > 0.0 && m->h < HUGE_VAL)
        s = smooth_sign(m->d / m->h, law->sharpness);
    double way = s * m->d;
    if (z * s < 0.0) { /* bent in the other direction: first back to zero */
        const Bristles *const b = towards_side(law, -m->d);
        const double rest = bristles_rest(b, s, g.mean);
        const double back = bristles_length(b, g.mean) * log(1.0 - z / rest);
        if (back >= way) {
            state[0] = settled(z, rest, bristles_run(b, g.mean, way));
            return;
        }
        way -= back;
        z = 0.0;
    }
    const double run = bristles_run(q, g.mean, way);
    state[0] = z;
    if (run > 0.0)
        state[0] = towards(z, bristles_rest(q, s, g.first), bristles_rest(q, s, g.last), run);
}

/* ---- power: the relative distance to the final force falls with a power of itself ---- */

static double power_friction(const Law *law, const double *state, Pace pace) { return state[0]; }

static void power_wear(const Law *law, double *state, double speed, double h, double v)
{
    state[0] *= exp(-power_decay(towards_side(law, v)) * (speed * h));
}

static void power_move(const Law *law, double *state, const Move *m)
{
    const Power *const q = towards_side(law, m->d);
    const double rest = sign_of(m->d) * power_rest(q), run = power_decay(q) * fabs(m->d);
    const double power = 1.0 - power_exponent(q);
    double left = fmax(1.0 - state[0] / rest, 0.0);
    if (fabs(power) < 1e-9) {
        left *= exp(-run);
    } else if (left > 0.0) {
        const double base = pow(left, power) - power * run;
        left = base > 0.0 ? pow(base, 1.0 / power) : 0.0;
    }
    state[0] = rest * (1.0 - left);
}

/* ---- relaxing: two linear systems in the distance ---- */

static double relaxing_friction(const Law *law, const double *state, Pace pace)
{
    return state[0] + state[1];
}

static void relaxing_wear(const Law *law, double *state, double speed, double h, double v)
{
    const Relaxing *const q = towards_side(law, v);
    state[0] *= exp(-relaxing_fast_run(q, speed * h));
    state[1] *= exp(-relaxing_slow_run(q, speed * h));
}

static void relaxing_move(const Law *law, double *state, const Move *m)
{
    const Relaxing *const q = towards_side(law, m->d);
    const double s = sign_of(m->d), way = fabs(m->d);
    state[0] = settled(state[0], s * relaxing_fast_rest(q), relaxing_fast_run(q, way));
    state[1] = settled(state[1], s * relaxing_slow_rest(q), relaxing_slow_run(q, way));
}

/* ---- elements: their forces, then 1 or -1 for each that slips that way, or 0 ---- */

static double elements_friction(const Law *law, const double *state, Pace pace)
{
    return elements_force(towards_side(law, pace.v), state, pace.v);
}

static void elements_wear(const Law *law, double *state, double speed, double h, double v)
{
    const Elements *const q = towards_side(law, v);
    for (int i = 0; i < COUNT; i++)
        state[i] *= exp(-elements_loading(q, i, speed * h) / elements_rest(q, i, q->Fs));
}

static void elements_move(const Law *law, double *state, const Move *m)
{
    const Elements *const q = towards_side(law, m->d);
    const double d = m->d, h = m->h, s = sign_of(d);
    const Curve g = curve_over(law, m);
    for (int i = 0; i < COUNT; i++) {
        double left = 1.0; /* share of the step in which the element slips */
        if (state[COUNT + i] * s <= 0.0) {
            state[COUNT + i] = 0.0;
            const double loading = elements_loading(q, i, d), loaded = state[i] + loading;
            const double limit = elements_rest(q, i, g.mean);
            if (s * loaded < limit) {
                state[i] = loaded;
                continue;
            }
            left = fmin(fmax((loaded - s * limit) / loading, 0.0), 1.0);
            state[i] = s * elements_rest(q, i, g.first + (g.last - g.first) * (1.0 - left));
            state[COUNT + i] = s;
        }
        if (h == HUGE_VAL)
            continue;
        const double run = elements_run(q, fabs(d) / h, g.mean, left * h);
        if (run > 0.0) {
            const double begin = elements_rest(q, i, g.last + (g.first - g.last) * left);
            state[i] = towards(state[i], s * begin, s * elements_rest(q, i, g.last), run);
        }
    }
}

/* ---- dry: a function of the velocity, without a state ---- */

static double dry_friction(const Law *law, const double *state, Pace pace)
{
    return dry_force(towards_side(law, pace.v), sign_of(pace.v), pace.v, pace.curve);
}

/* ---- solved: the equations of any other law, by the core; NAN if it fails ---- */

static void put_before_core(const Law *law, const double *state, double v)
{
    const Equations *const e = law->equations;
    memcpy(e->x, state, (size_t)e->states * sizeof *state);
    memcpy(e->p, towards_side(law, v), (size_t)law->count * sizeof *state);
    *e->v = v;
}

static double solved_friction(const Law *law, const double *state, Pace pace)
{
    put_before_core(law, state, pace.v);
    law->equations->output(law->equations->instance, 0.0);
    return *law->equations->friction;
}

static void solved_move(const Law *law, double *state, const Move *m)
{
    const Equations *const e = law->equations;
    const double h = m->h == HUGE_VAL ? fabs(m->d) / SLOW : m->h;
    if (e->states == 0 || isnan(state[0]))
        return;
    put_before_core(law, state, m->d / h);
    *e->next_step = h;
    if (e->step(e->instance, 0.0, h, e->tolerance, MOST_STEPS))
        e->x[0] = NAN;
    memcpy(state, e->x, (size_t)e->states * sizeof *state);
}

static const Form FORMS[] = {
    [BRISTLES] = {bristles_friction, bristles_wear, bristles_move},
    [POWER] = {power_friction, power_wear, power_move},
    [RELAXING] = {relaxing_friction, relaxing_wear, relaxing_move},
    [ELEMENTS] = {elements_friction, elements_wear, elements_move},
    [DRY] = {dry_friction, NULL, NULL},
    [SOLVED] = {solved_friction, NULL, solved_move},
};

static inline Pace pace_of(const Law *law, double v) { return (Pace){v, curve(law, v, v)}; }

static inline double friction_at(const Law *law, const double *state, Pace pace)
{
    return FORMS[law->form].friction(law, state, pace);
}

static inline void move(const Law *law, double *state, double d, double h, Pace before, Pace after)
{
    const Move m = {d, h, before, after};
    if (d != 0.0 && FORMS[law->form].move)
        FORMS[law->form].move(law, state, &m);
}

/* Set a state without force. */
static void begin(const Law *law, double *state)
{
    memset(state, 0, STATES * sizeof *state);
    if (law->equations)
        memcpy(state, law->equations->start, (size_t)law->equations->states * sizeof *state);
}

/* A displacement d in h, to the velocity v. */
static inline void advance(const Law *law, double *state, double d, double h, Pace *now, double v)
{
    const Pace next = pace_of(law, v);
    move(law, state, d, h, *now, next);
    *now = next;
}

/* `own`: rows of `records`, see law_along_record.py. */
API void friction_along(const Law *law, const double *x, const double *v, const double *step,
                        const int64_t *starts, int64_t records, const double *own,
                        double *friction)
{
    double state[STATES];
    const int dry = law->form == DRY;
    const Pace still = {0.0, 0.0};
    for (int64_t r = 0; r < records; r++) {
        const double first = own[records + r], gain = own[2 * records + r];
        const double bend = own[3 * records + r], vibration = own[4 * records + r];
        double place = 0.0;
        Pace now = still;
        begin(law, state);
        move(law, state, own[r], HUGE_VAL, still, still); /* slow, because no sample shows it */
        for (int64_t k = starts[r]; k < starts[r + 1]; k++) {
            const double way = x[k] - first, at = first + way * (1.0 + gain + bend * way);
            const double pace = v[k] * (1.0 + gain + 2.0 * bend * way);
            if (dry) { /* without a state */
                friction[k] = dry_friction(law, state, pace_of(law, pace));
                continue;
            }
            const double d = k > starts[r] ? at - place : 0.0;
            if (k > starts[r] && vibration != 0.0 && FORMS[law->form].wear)
                FORMS[law->form].wear(law, state, vibration, step[r], now.v);
            advance(law, state, d, step[r], &now, pace);
            friction[k] = friction_at(law, state, now);
            place = at;
        }
    }
}
