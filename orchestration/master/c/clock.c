/* Communication points: multiples of one tick, so that time does not drift, and some in between. */

/* The time of a run. */
typedef struct {
    double tick;      /* unit of time [s] */
    double stop;      /* end [s] */
    int64_t last, longest; /* ticks of the run, and of the longest step */
    int64_t count, stride; /* elapsed ticks, and ticks of the next step */
    double shortest_used, longest_used; /* [s] */
    double close;   /* times that are closer to each other count as equal [s] */
    Vector breaks;  /* further times at which a step has to end, rising [s] */
    int64_t passed; /* number of breaks that are passed */
    int64_t broken; /* whether the present time is the last of them, between two multiples */
} Clock;

static double clock_place(const Clock *c, int64_t ticks)
{
    return fmin((double)ticks * c->tick, c->stop);
}

API double clock_now(const Clock *c)
{
    return c->broken ? c->breaks.at[c->passed - 1] : clock_place(c, c->count);
}

static int clock_done(const Clock *c) { return c->count >= c->last; }

/* Elapsed ticks at the next multiple of the step. */
static int64_t next_place(const Clock *c)
{
    int64_t place = c->count + c->stride;
    while (c->broken && (double)place * c->tick <= clock_now(c) + c->close)
        place += c->stride;
    return place < c->last ? place : c->last;
}

/* Whether the next step has to end before that, at a break. */
static int breaks_next(const Clock *c)
{
    return c->passed < c->breaks.size &&
           c->breaks.at[c->passed] < clock_place(c, next_place(c)) - c->close;
}

static double next_time(const Clock *c)
{
    return breaks_next(c) ? c->breaks.at[c->passed] : clock_place(c, next_place(c));
}

/* Length of the next step [s]: a multiple of the tick, but at the end and from and to a break. */
API double clock_step_to_come(const Clock *c)
{
    const int64_t following = next_place(c);
    if (c->broken || breaks_next(c) || (double)following * c->tick > c->stop)
        return next_time(c) - clock_now(c);
    return (double)(following - c->count) * c->tick;
}

/* Move to the end of the step. */
static void clock_accept(Clock *c)
{
    const double step = clock_step_to_come(c);
    c->shortest_used = fmin(c->shortest_used, step);
    c->longest_used = fmax(c->longest_used, step);
    if (breaks_next(c)) {
        c->broken = 1;
        c->passed++;
    } else {
        c->count = next_place(c);
        c->broken = 0;
    }
    while (!c->broken && c->passed < c->breaks.size &&
           c->breaks.at[c->passed] <= clock_now(c) + c->close)
        c->passed++;
}
