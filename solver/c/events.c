/* Events: which are due, where in a step, and what follows; part of `stepper.c`. */
#define INSIDE 4 /* parts of a step at whose ends crossings are searched */

/* Note the effect of an event on tangents, and carry it out.
 *
 * The first event since the note was cleared determines the time of all events that follow at once.
 * A tangent d becomes (a + (f - b) w) d, with f the state's rate after the last: this is the
 * saltation matrix (e.g. R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth
 * Mechanical Systems, Springer 2004, Section 7). */
static void note_event(GIVEN, int k, Note *note)
{
    const int n = s->states;
    memset(note->gradient, 0, (size_t)n * sizeof(double));
    memset(note->by_time, 0, (size_t)n * sizeof(double));
    memset(note->reset, 0, (size_t)(n * n) * sizeof(double));
    double rate = s->slopes(s, t, x, u, p, k, note->gradient, note->reset, note->by_time);
    if (!note->any) {
        note->any = 1;
        s->rhs(s, t, x, u, p, note->b);
        for (int i = 0; i < n; i++)
            rate += note->gradient[i] * note->b[i];
        for (int i = 0; i < n; i++) {
            note->w[i] = note->gradient[i] / rate;
            for (int j = 0; j < n; j++)
                note->a[i * n + j] = i == j ? 1.0 : 0.0;
        }
    }
    for (int i = 0; i < n; i++) {
        double moved = note->by_time[i];
        for (int j = 0; j < n; j++)
            moved += note->reset[i * n + j] * note->b[j];
        note->gradient[i] = moved;
        for (int j = 0; j < n; j++) {
            double total = 0.0;
            for (int l = 0; l < n; l++)
                total += note->reset[i * n + l] * note->a[l * n + j];
            note->product[i * n + j] = total;
        }
    }
    memcpy(note->b, note->gradient, (size_t)n * sizeof(double));
    memcpy(note->a, note->product, (size_t)(n * n) * sizeof(double));
}

static void react_to(const System *s, double t, double *x, double *u, const double *p, int k,
                     Work *work, Info *info)
{
    if (work->note)
        note_event(s, t, x, u, p, k, work->note);
    s->react(s, t, x, u, p, k);
    info->events += 1.0;
}

/* Carry out every event that is due at this instant; return DONE or CHATTER. */
static int settle(const System *s, double t, double *x, double *u, const double *p, Work *work,
           Info *info)
{
    const int events = s->events;
    if (events == 0)
        return DONE;
    memset(work->fired, 0, (size_t)events * sizeof *work->fired);
    for (int round = 0; round < MOST_AT_ONCE; round++) {
        int due = -1;
        s->indicate(s, t, x, u, p, work->g);
        for (int k = 0; k < events && due < 0; k++) {
            const int what = s->kind(s, u, k);
            if (work->g[k] > 0.0 && what != EITHER && !(what == RESETS && work->fired[k]))
                due = k;
        }
        if (due < 0)
            return DONE;
        if (s->kind(s, u, due) == RESETS)
            work->fired[due] = 1;
        else
            memset(work->fired, 0, (size_t)events * sizeof *work->fired);
        react_to(s, t, x, u, p, due, work, info);
    }
    info->reached = t;
    return CHATTER;
}

/* The event whose indicator is furthest past zero and was not before; -1 if there is none. */
static int due_at(GIVEN, Work *work)
{
    double best = 0.0;
    int found = -1;
    s->indicate(s, t, x, u, p, work->g);
    for (int k = 0; k < s->events; k++) {
        const int what = s->kind(s, u, k);
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
static void look_before(GIVEN, double *before)
{
    s->indicate(s, t, x, u, p, before);
    for (int k = 0; k < s->events; k++) {
        if (s->kind(s, u, k) == EITHER)
            before[k] = before[k] > 0.0 ? 1.0 : (before[k] < 0.0 ? -1.0 : 0.0);
    }
}

/* Length of the part of a step that ends at its first event, h if there is none; the state at its
 * end goes to work->stage. An event that changes the mode, or that is watched in both directions,
 * happens just after the crossing; one that only resets the state happens just before it, so that
 * the reset finds its indicator on the original side. */
static double locate(const System *s, double t, double h, const double *x, const double *u,
                     const double *p, const double *atol, double rtol, Work *work)
{
    const int n = s->states;
    const size_t size = (size_t)n * sizeof(double);
    look_before(s, t, x, u, p, work->before);
    /* The cubic Hermite polynomial through both ends shows two crossings within one step. */
    memcpy(work->end, work->stage, size);
    s->rhs(s, t + h, work->end, u, p, work->slope);
    double high = -1.0;
    for (int part = 1; part < INSIDE; part++) {
        const double q = (double)part / INSIDE;
        hermite(n, q, h, x, work->first, work->end, work->slope, work->middle);
        if (due_at(s, t + q * h, work->middle, u, p, work) >= 0) {
            attempt(s, t, q * h, x, u, p, atol, rtol, work);
            if (due_at(s, t + q * h, work->stage, u, p, work) >= 0) {
                high = q * h;
                break;
            }
            s->rhs(s, t + h, work->end, u, p, work->slope); /* the attempt has overwritten it */
        }
    }
    if (high < 0.0) {
        if (due_at(s, t + h, work->end, u, p, work) < 0) {
            memcpy(work->stage, work->end, size);
            if (s->delays) /* shorter attempts have overwritten its stages */
                attempt(s, t, h, x, u, p, atol, rtol, work);
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
        attempt(s, t, half, x, u, p, atol, rtol, work);
        if (due_at(s, t + half, work->stage, u, p, work) >= 0)
            high = half;
        else
            low = half;
    }
    attempt(s, t, high, x, u, p, atol, rtol, work);
    work->found = due_at(s, t + high, work->stage, u, p, work);
    if (work->found >= 0 && s->kind(s, u, work->found) == RESETS) {
        high = low;
        if (low > 0.0)
            attempt(s, t, low, x, u, p, atol, rtol, work);
        else
            memcpy(work->stage, x, size);
    }
    return high;
}

/* Whether the event at t exceeds the allowed number of events without time between them. */
static int crowded(Crowd *crowd, double t, double least)
{
    crowd->count = t - crowd->last > least ? 0 : crowd->count + 1;
    crowd->last = t;
    return crowd->count > MOST_AT_ONCE;
}
