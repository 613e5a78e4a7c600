/* Communication points as multiples of one tick, so that time does not drift. */
#include <math.h>
#include <stdint.h>

/* Where a run stands. */
typedef struct {
    double tick;      /* unit of time [s] */
    double stop;      /* end [s] */
    int64_t last;     /* ticks of the run */
    int64_t longest;  /* ticks of the longest step */
    int64_t adaptive;
    int64_t count;    /* ticks gone */
    int64_t stride;   /* ticks of the step to come */
    double shortest_used, longest_used; /* [s] */
} Clock;

API double clock_now(const Clock *c) { return fmin((double)c->count * c->tick, c->stop); }

static int clock_done(const Clock *c) { return c->count >= c->last; }

/* Ticks gone after the step to come. */
static int64_t next_place(const Clock *c)
{
    const int64_t place = c->count + c->stride;
    return place < c->last ? place : c->last;
}

static double next_time(const Clock *c)
{
    return fmin((double)next_place(c) * c->tick, c->stop);
}

/* Length of the step to come [s]: a multiple of the tick, but for a last, shorter one. */
API double clock_step_to_come(const Clock *c)
{
    const int64_t following = next_place(c);
    if ((double)following * c->tick > c->stop)
        return c->stop - clock_now(c);
    return (double)(following - c->count) * c->tick;
}

/* Go on by the step. */
static void clock_accept(Clock *c)
{
    const double step = clock_step_to_come(c);
    c->shortest_used = fmin(c->shortest_used, step);
    c->longest_used = fmax(c->longest_used, step);
    c->count = next_place(c);
}

/* Halve or double the step, so that steps stay aligned with multiples of themselves; `share` is what
 * the last one cost of what it may. */
static void clock_adapt(Clock *c, double share)
{
    if (share > 1.0 && c->stride > 1)
        c->stride /= 2;
    else if (share < 0.1 && c->stride < c->longest && c->count % (2 * c->stride) == 0)
        c->stride *= 2;
}
