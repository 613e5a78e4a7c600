/* Likelihood of samples rounded by an instrument, and their delay; see `score` and `delayed` in
 * law_along_record.py. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define ROOT_2 1.4142135623730951
#define BELL 0.3989422804014327 /* one over the root of two pi */

/* The normal distribution's mass between two points, accurate in the tails. */
static double mass_between(double low, double high)
{
    if (low > 0.0)
        return 0.5 * (erfc(low / ROOT_2) - erfc(high / ROOT_2));
    return 0.5 * (erfc(-high / ROOT_2) - erfc(-low / ROOT_2));
}

static double bell(double at) { return BELL * exp(-0.5 * at * at); }

/* Expected products of the score's parts: the sum over all counts to which a sample with the offset
 * `off` can be rounded. */
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
                 double count, double *gradient, double *information, int64_t cost_only)
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
        } else { /* far out: the nearest edge of the count dominates */
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

#define FORGETS 30 /* samples in which the filter forgets its start */

/* Sample j of a record of `many`, and of its slope before and after it. */
static double extended(const double *own, int64_t way, int64_t many, int64_t j)
{
    if (j < 0)
        return 2.0 * own[0] - own[-way * j];
    return j < many ? own[way * j] : 2.0 * own[way * (many - 1)] - own[way * (many - 2)];
}

/* Thiran's filter of first order for one sample more, forwards in time for a delay, else backwards. */
API void delayed(const double *forces, int64_t rows, int64_t n, const int64_t *starts,
                 int64_t records, const double *late, double *out)
{
    for (int64_t k = 0; k < rows * records; k++) {
        const int64_t r = k % records, many = starts[r + 1] - starts[r];
        const int64_t start = k / records * n + starts[r], way = late[r] > 0.0 ? 1 : -1;
        const int64_t edge = start + (way > 0 ? 0 : many - 1);
        const double *const own = forces + edge;
        double *const moved = out + edge;
        const double c = -fabs(late[r]) / (2.0 + fabs(late[r]));
        const int64_t before = many - 1 < FORGETS ? many - 1 : FORGETS;
        if (late[r] == 0.0) {
            memcpy(out + start, forces + start, (size_t)many * sizeof *out);
            continue;
        }
        double kept = (1.0 - c) * extended(own, way, many, -before);
        for (int64_t j = -before; j <= many; j++) {
            const double x = extended(own, way, many, j), y = kept + c * x;
            kept = x - c * y;
            if (j > 0)
                moved[way * (j - 1)] = y;
        }
    }
}
