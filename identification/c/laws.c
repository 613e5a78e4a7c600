/* Friction laws along a given motion, and the likelihood of rounded samples; see
 * law_along_record.py, which says what each function is for and in which units.
 *
 * Between two samples the velocity is taken as constant, and g(v) as moving evenly; then every law
 * here has an exact step, which is stable however stiff the law is. Every parameter comes twice, for
 * motion forwards and backwards. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

#define PI 3.141592653589793
#define ELEMENTS 4 /* of Maxwell slip */
#define LUGRE_PARAMETERS 6
#define STATES (2 * ELEMENTS) /* of any law */
#define GAP_PARTS 8           /* steps between two samples */
#define SLOWEST_SLIP 1e-7     /* of the plant's Maxwell-slip law [m/s] */
#define SPRING_STEP 0.15      /* over the spring's own time */

enum { LUGRE, DAHL, BLIMAN_SORINE, MAXWELL_SLIP, CLASSICAL };

/* A law with its parameters by direction. LuGre's sigma0 goes with the side to which the bristles are
 * bent. */
typedef struct {
    int32_t kind;
    int32_t count; /* of parameters */
    const double *forwards, *backwards;
    double sharpness; /* Kv of the modified law [s/m]; 0 for abs(v) itself */
} Law;

static double square(double x) { return x * x; }

/* The bell exp(-s^2), which takes long to be the nothing it is far out. */
static double fading(double s) { return square(s) < 746.0 ? exp(-square(s)) : 0.0; }

static double stribeck(double v, double fc, double fs, double vs)
{
    return fc + (fs - fc) * fading(v / vs);
}

/* LuGre's curve; with two more parameters, one more bend of it at low speed. */
static double bent(const Law *law, double v, const double *q)
{
    double g = stribeck(v, q[3], q[4], q[5]);
    if (law->count > LUGRE_PARAMETERS)
        g += q[LUGRE_PARAMETERS] * fading(v / q[LUGRE_PARAMETERS + 1]);
    return g;
}

/* A velocity [m/s], and the law's curve there [N], which costs most and is asked for again. */
typedef struct {
    double v, curve;
} Pace;

static Pace pace_of(const Law *law, double v)
{
    const double *const q = v > 0.0 ? law->forwards : law->backwards;
    const double *const last = q + 2 * ELEMENTS;
    switch (law->kind) {
    case DAHL:
    case BLIMAN_SORINE: return (Pace){v, 0.0};
    case MAXWELL_SLIP: return (Pace){v, stribeck(v, last[2], last[3], last[4])};
    case CLASSICAL: return (Pace){v, stribeck(v, q[1], q[2], q[3])};
    default: return (Pace){v, bent(law, v, q)};
    }
}

/* Friction at a sample [N]. */
static double friction_at(const Law *law, const double *state, Pace pace)
{
    const double v = pace.v;
    const double *const q = v > 0.0 ? law->forwards : law->backwards;
    switch (law->kind) {
    case DAHL: return state[0];
    case BLIMAN_SORINE: return state[0] + state[1];
    case MAXWELL_SLIP:
        return state[0] + state[1] + state[2] + state[3] + q[2 * ELEMENTS + 1] * v;
    case CLASSICAL: return (v > 0.0 ? 1.0 : -1.0) * pace.curve + q[0] * v;
    default: break;
    }
    const double z = state[0];
    const double *const b = z > 0.0 ? law->forwards : law->backwards;
    const double g = pace.curve;
    double rate = v - b[0] * fabs(v) * z / g;
    if (law->sharpness > 0.0) {
        const double s = 2.0 / PI * atan(law->sharpness * v);
        rate = s * s * v - b[0] * s * v * z / g;
    }
    return b[0] * z + q[1] * rate + q[2] * v;
}

/* What going `way` to and fro [m] leaves of the deflection. */
static void wear(const Law *law, double *state, double way, double v)
{
    const double *const q = v > 0.0 ? law->forwards : law->backwards;
    switch (law->kind) {
    case DAHL: state[0] *= exp(-q[0] * way / q[1]); return;
    case BLIMAN_SORINE:
        state[0] *= exp(-way / (q[3] * q[2]));
        state[1] *= exp(-way / q[2]);
        return;
    case MAXWELL_SLIP:
        for (int i = 0; i < ELEMENTS; i++)
            state[i] *= exp(-q[i] * way / (q[ELEMENTS + i] * q[2 * ELEMENTS + 3]));
        return;
    case CLASSICAL: return;
    default:
        state[0] *= exp(-(state[0] > 0.0 ? law->forwards : law->backwards)[0] * way / q[4]);
    }
}

/* A displacement d [m] in h [s], between two velocities. */
typedef struct {
    double d, h;
    Pace before, after;
} Move;

/* Whether a move goes one way all along: its curve is then that of both ends. */
static int goes_on(const Move *m) { return m->before.v * m->d > 0.0 && m->after.v * m->d > 0.0; }

/* Where a state that tends to a rest comes, while the rest moves evenly from `begin` to `end`. */
static double towards(double state, double begin, double end, double run)
{
    const double gone = -expm1(-run);
    return end + (state - begin) * (1.0 - gone) - (end - begin) * gone / run;
}

static void move_dahl(const double *q, double *state, double d)
{
    const double s = d > 0.0 ? 1.0 : -1.0, run = q[0] / q[1] * fabs(d);
    double left = fmax(1.0 - s * state[0] / q[1], 0.0);
    if (fabs(q[2] - 1.0) < 1e-9) {
        left *= exp(-run);
    } else if (left > 0.0) {
        const double base = pow(left, 1.0 - q[2]) - (1.0 - q[2]) * run;
        left = base > 0.0 ? pow(base, 1.0 / (1.0 - q[2])) : 0.0;
    }
    state[0] = s * q[1] * (1.0 - left);
}

static void move_bliman_sorine(const double *q, double *state, double d)
{
    const double s = d > 0.0 ? 1.0 : -1.0;
    const double slow = exp(-fabs(d) / q[2]), fast = exp(-fabs(d) / (q[2] * q[3]));
    state[0] = s * q[0] + (state[0] - s * q[0]) * fast;
    state[1] = -s * q[1] + (state[1] + s * q[1]) * slow;
}

static void move_bristles(const Law *law, double *state, const Move *m)
{
    const double d = m->d, w = d / m->h;
    const double *const q = d > 0.0 ? law->forwards : law->backwards;
    double s = d > 0.0 ? 1.0 : -1.0, z = state[0];
    if (law->sharpness > 0.0 && m->h < HUGE_VAL)
        s = 2.0 / PI * atan(law->sharpness * w);
    double first, last;
    if (goes_on(m)) {
        first = m->before.curve;
        last = m->after.curve;
    } else {
        first = last = bent(law, w, q);
    }
    const double g = 0.5 * (first + last);
    double way = s * d;
    if (z * s < 0.0) { /* bent to the other side: first back to nothing */
        const double *const b = d > 0.0 ? law->backwards : law->forwards;
        const double rest = s * g / b[0], back = g / b[0] * log(1.0 - z / rest);
        if (back >= way) {
            state[0] = rest + (z - rest) * exp(-b[0] * way / g);
            return;
        }
        way -= back;
        z = 0.0;
    }
    /* towards a rest that moves evenly from that of the first velocity to the last's */
    const double run = q[0] * way / g;
    state[0] = run > 0.0 ? towards(z, s * first / q[0], s * last / q[0], run) : z;
}

/* Maxwell slip: forces of the elements, then 1 or -1 for each that slips that way, or 0. */
static void move_elements(const double *q, double *state, const Move *m)
{
    const double d = m->d, h = m->h, s = d > 0.0 ? 1.0 : -1.0;
    const double attraction = q[2 * ELEMENTS], fc = q[2 * ELEMENTS + 2];
    const double fs = q[2 * ELEMENTS + 3], vs = q[2 * ELEMENTS + 4];
    double first, last;
    if (goes_on(m)) {
        first = m->before.curve;
        last = m->after.curve;
    } else {
        first = last = stribeck(d / h, fc, fs, vs);
    }
    const double g = 0.5 * (first + last);
    for (int i = 0; i < ELEMENTS; i++) {
        const double share = q[ELEMENTS + i];
        double left = 1.0; /* share of the step in which the element slips */
        if (state[ELEMENTS + i] * s <= 0.0) {
            state[ELEMENTS + i] = 0.0;
            const double loaded = state[i] + q[i] * d;
            if (s * loaded < share * g) {
                state[i] = loaded;
                continue;
            }
            left = fmin(fmax((loaded - s * share * g) / (q[i] * d), 0.0), 1.0);
            state[i] = s * share * (first + (last - first) * (1.0 - left));
            state[ELEMENTS + i] = s;
        }
        if (h == HUGE_VAL)
            continue;
        const double run = attraction * left * h / g / (1.0 + SLOWEST_SLIP * h / fabs(d));
        if (run > 0.0) {
            const double begin = s * share * (last + (first - last) * left);
            state[i] = towards(state[i], begin, s * share * last, run);
        }
    }
}

static void move(const Law *law, double *state, double d, double h, Pace before, Pace after)
{
    const Move m = {d, h, before, after};
    const double *const q = d > 0.0 ? law->forwards : law->backwards;
    if (d == 0.0)
        return;
    switch (law->kind) {
    case DAHL: move_dahl(q, state, d); return;
    case BLIMAN_SORINE: move_bliman_sorine(q, state, d); return;
    case MAXWELL_SLIP: move_elements(q, state, &m); return;
    case CLASSICAL: return;
    default: move_bristles(law, state, &m);
    }
}

API void friction_along(const Law *law, const double *x, const double *v, const double *step,
                        const int64_t *starts, int64_t records, const double *shifts,
                        const double *shaking, double *friction)
{
    double state[STATES];
    for (int64_t r = 0; r < records; r++) {
        const double h = step[r];
        memset(state, 0, sizeof state);
        /* slow, as far as the law is concerned: no sample saw it */
        const Pace still = {0.0, 0.0};
        move(law, state, shifts[r], HUGE_VAL, still, still);
        Pace now = pace_of(law, v[starts[r]]);
        for (int64_t k = starts[r]; k < starts[r + 1]; k++) {
            friction[k] = friction_at(law, state, now);
            if (k + 1 == starts[r + 1])
                break;
            const Pace next = pace_of(law, v[k + 1]);
            wear(law, state, shaking[r] * h, v[k]);
            move(law, state, x[k + 1] - x[k], h, now, next);
            now = next;
        }
    }
}

/* Motion between two samples: the cubic through both positions and velocities. */
typedef struct {
    double x, way, v, change, left, right, step;
} Between;

static Between between(const double *x, const double *v, double step)
{
    const double mean = (x[1] - x[0]) / step;
    return (Between){x[0], x[1] - x[0], v[0], v[1] - v[0], v[0] - mean, v[1] - mean, step};
}

static double place_at(const Between *b, double s)
{
    const double bend = s * (1.0 - s) * b->step * ((1.0 - s) * b->left - s * b->right);
    return b->x + s * b->way + bend;
}

static double pace_at(const Between *b, double s) { return b->v + s * b->change; }

API void mean_friction_along(const Law *law, const double *x, const double *v, int64_t n,
                             double step, int parts, double *friction)
{
    double state[STATES] = {0.0}, place = x[0];
    Pace pace = pace_of(law, v[0]);
    const double h = step / parts;
    for (int64_t k = 0; k < n - 1; k++) {
        const Between b = between(x + k, v + k, step);
        double total = 0.5 * friction_at(law, state, pace);
        for (int j = 1; j <= parts; j++) {
            const double s = (double)j / parts;
            const double after = place_at(&b, s);
            const Pace then = pace_of(law, pace_at(&b, s));
            move(law, state, after - place, h, pace, then);
            place = after;
            pace = then;
            total += (j < parts ? 1.0 : 0.5) * friction_at(law, state, pace);
        }
        friction[k] = total / parts;
    }
    friction[n - 1] = friction[n - 2];
}

API void force_behind_spring(const Law *law, const double *x, const double *v, int64_t n,
                             double step, double stiffness, double mass, double *force)
{
    double state[STATES] = {0.0}, block = x[0];
    Pace speed = pace_of(law, v[0]);
    const double damping = 0.2 * sqrt(stiffness * mass), rate = sqrt(stiffness / mass);
    const int parts = (int)fmax(4.0, ceil(step * rate / SPRING_STEP));
    const double h = step / parts;
    for (int64_t k = 1; k < n; k++) {
        const Between b = between(x + k - 1, v + k - 1, step);
        double total = 0.0;
        for (int j = 0; j < parts; j++) {
            const double s = (j + 1.0) / parts;
            const double place = place_at(&b, s), pace = pace_at(&b, s);
            const double friction = friction_at(law, state, speed), v0 = speed.v;
            /* implicit in what joins the two: stable however stiff */
            const double pull = stiffness * (place - block - h * v0) + damping * (pace - v0);
            const double heavy = mass + h * damping + h * h * stiffness;
            const Pace then = pace_of(law, v0 + h * ((pull - friction) / heavy));
            const double d = h * then.v;
            move(law, state, d, h, speed, then);
            block += d;
            total += stiffness * (place - block) + damping * (pace - then.v);
            speed = then;
        }
        force[k - 1] = total / parts;
    }
    force[n - 1] = force[n - 2];
}

API void force_behind_gap(const Law *law, const double *x, const double *v, int64_t n, double step,
                          double gap, double mass, double *force)
{
    double state[STATES] = {0.0}, block = x[0], side = 0.0;
    Pace speed = pace_of(law, 0.0);
    const double h = step / GAP_PARTS;
    for (int64_t k = 0; k < n - 1; k++) {
        const Between b = between(x + k, v + k, step);
        const double pull = b.change / step;
        double total = 0.0;
        for (int j = 1; j <= GAP_PARTS; j++) {
            const double s = (double)j / GAP_PARTS;
            const double push = place_at(&b, s), pushed = pace_at(&b, s);
            const Pace before = speed;
            double place;
            if (side != 0.0) {
                place = push - side * 0.5 * gap;
                speed = pace_of(law, pushed);
                move(law, state, place - block, h, before, speed);
                block = place;
                double contact = mass * pull + friction_at(law, state, speed);
                if (side * contact < 0.0)
                    contact = side = 0.0;
                total += contact;
                continue;
            }
            double slid = speed.v - h / mass * friction_at(law, state, speed);
            place = block + h * slid;
            const double off = push - place;
            if (fabs(off) > 0.5 * gap) {
                side = off > 0.0 ? 1.0 : -1.0;
                place = push - side * 0.5 * gap;
                total += mass * (pushed - slid) / h;
                slid = pushed;
            }
            speed = pace_of(law, slid);
            move(law, state, place - block, h, before, speed);
            block = place;
        }
        force[k] = total / GAP_PARTS;
    }
    force[n - 1] = force[n - 2];
}

/* -- likelihood of rounded samples ------------------------------------------------------------ */

#define ROOT_2 1.4142135623730951
#define BELL 0.3989422804014327 /* one over the root of two pi */

/* The normal distribution's mass between two places; the tail on the far side keeps its digits. */
static double mass_between(double low, double high)
{
    if (low > 0.0)
        return 0.5 * (erfc(low / ROOT_2) - erfc(high / ROOT_2));
    return 0.5 * (erfc(-high / ROOT_2) - erfc(-low / ROOT_2));
}

static double bell(double at) { return BELL * exp(-0.5 * at * at); }

/* Expected products of the score's parts: the sum over all counts that a sample that is off by `off`
 * might have fallen into. */
static void expect(double off, double spread, double count, double *twice, double *both,
                   double *spread_twice)
{
    const int reach = (int)ceil(5.0 * spread / count) + 1;
    const double shift = off - floor(off / count + 0.5) * count;
    *twice = *both = *spread_twice = 0.0;
    for (int j = -reach; j <= reach; j++) {
        const double b = (shift + (j + 0.5) * count) / spread;
        const double a = (shift + (j - 0.5) * count) / spread;
        const double chance = mass_between(a, b);
        if (chance > 1e-12) {
            const double at_a = bell(a) / spread, at_b = bell(b) / spread;
            const double moved = at_a - at_b, widened = a * at_a - b * at_b;
            *twice += moved * moved / chance;
            *both += moved * widened / chance;
            *spread_twice += widened * widened / chance;
        }
    }
}

API double score(const double *force, const double *predicted, const double *spread, int64_t n,
                 double count, double *gradient, double *information, int cost_only)
{
    double total = 0.0;
    /* a density times the count is the probability of the count */
    const double density = log(BELL) + (count > 0.0 ? log(count) : 0.0);
    for (int64_t k = 0; k < n; k++) {
        const double s = spread[k], off = force[k] - predicted[k];
        if (count <= 0.3 * s) { /* finer than the noise: rounding is one more variance */
            const double variance = s * s + count * count / 12.0;
            total += 0.5 * off * off / variance + 0.5 * log(variance) - density;
            gradient[k] = off / variance;
            gradient[n + k] = (off * off / variance - 1.0) * s / variance;
            information[k] = 1.0 / variance;
            information[n + k] = 0.0;
            information[2 * n + k] = 2.0 * s * s / (variance * variance);
            continue;
        }
        const double high = (off + 0.5 * count) / s, low = (off - 0.5 * count) / s;
        const double mass = mass_between(low, high);
        if (mass > 1e-250) {
            const double at_low = bell(low) / s, at_high = bell(high) / s;
            total -= log(mass);
            gradient[k] = (at_low - at_high) / mass;
            gradient[n + k] = (low * at_low - high * at_high) / mass;
        } else { /* far out: the nearest edge of the count decides */
            const double edge = low > 0.0 ? low : high;
            total += 0.5 * edge * edge + log(fabs(edge)) - log(BELL);
            gradient[k] = edge / s;
            gradient[n + k] = edge * edge / s;
        }
        if (!cost_only)
            expect(off, s, count, information + k, information + n + k, information + 2 * n + k);
    }
    return total;
}

/* Positions that come short by `play` [m] after a record's start and after each reversal. */
API void with_play(const double *x, const int64_t *starts, int64_t records, const double *play,
                   double *dragged)
{
    for (int64_t r = 0; r < records; r++) {
        double at = x[starts[r]];
        for (int64_t k = starts[r]; k < starts[r + 1]; k++) {
            at = fmin(fmax(at, x[k] - play[r]), x[k] + play[r]);
            dragged[k] = at;
        }
    }
}
