/* Events of model exchange: the host looks for them, by indicators that say when one is due. */
#ifndef EVENTS_H
#define EVENTS_H

#include "instance.h"

static double margin_of(double spread) { return MARGIN * spread + LEAST_MARGIN; }

/* Distance of an indicator beyond its event; negative before the event. */
static double past(const Watch *w, double g) { return w->level < 0.0 ? w->level - g : g - w->level; }

/* Begin to watch the events of a new mode: those beyond zero are due immediately. */
static void watch_mode(Instance *c)
{
    SPREAD(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++) {
        const double margin = margin_of(c->work.g[k]);
        c->watch[k] = (Watch){margin, margin, 1, 0};
    }
}

/* The event that is due; -1 if there is none. `fired` are resets that have happened already. */
static int due_now(Instance *c, const int32_t *fired)
{
    SYSTEM.indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++) {
        const Watch *w = &c->watch[k];
        if (!fired[k] && past(w, c->work.g[k]) > -0.5 * w->margin)
            return k;
    }
    return -1;
}

/* Continue to watch from here, with every indicator away from zero. An indicator that stays
 * positive after its event has to rise further, or to fall and rise again. */
static void watch_on(Instance *c, const int32_t *fired)
{
    SYSTEM.indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    SPREAD(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.before);
    for (int k = 0; k < EVENTS; k++) {
        Watch *w = &c->watch[k];
        const double g = c->work.g[k], margin = margin_of(c->work.before[k]);
        const double most = fired[k] ? HUGE_VAL : w->level;
        if (SYSTEM.kind(&SYSTEM, HELD(c), k) != EITHER) {
            w->level = larger(margin, smaller(most, g + margin));
        } else if (fabs(g) > 0.5 * margin) {
            w->level = g > 0.0 ? -margin : margin;
            w->undecided = 0;
        } else {
            w->level = w->level < 0.0 ? -margin : margin;
        }
        w->margin = margin;
    }
}

/* Carry out every event that is due at this instant; return DONE or CHATTER. */
static int let_happen(Instance *c)
{
    int32_t *const fired = c->work.fired;
    memset(fired, 0, (size_t)EVENTS * sizeof *fired);
    for (int round = 0; round < MOST_AT_ONCE; round++) {
        const double mode = MODES > 0 ? HELD(c)[HELD_SIZE - 1] : 0.0;
        const int k = due_now(c, fired);
        if (k < 0) {
            watch_on(c, fired);
            return DONE;
        }
        const int what = SYSTEM.kind(&SYSTEM, HELD(c), k);
        Watch *w = &c->watch[k];
        if (what == EITHER) {
            const int decided = !w->undecided;
            w->level = -w->level;
            w->undecided = 0;
            if (!decided)
                continue;
        }
        SYSTEM.react(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), k);
        INFO(c)->events += 1;
        fired[k] = what == RESETS;
        if (what == CHANGES_MODE || (MODES > 0 && HELD(c)[HELD_SIZE - 1] != mode)) {
            memset(fired, 0, (size_t)EVENTS * sizeof *fired);
            watch_mode(c);
        }
    }
    return CHATTER;
}

/* Put the indicators, as the host sees them, into work.g. */
static void show_indicators(Instance *c)
{
    SYSTEM.indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++)
        c->work.g[k] -= c->watch[k].level;
}

/* After a step of the host: whether an event is due that the host has not found. */
static int complete_step(Instance *c)
{
    int missed = 0;
    if (EVENTS == 0)
        return 0;
    SYSTEM.indicate(&SYSTEM, TIME(c), STATES(c), HELD(c), PARAMETERS(c), c->work.g);
    for (int k = 0; k < EVENTS; k++) {
        Watch *w = &c->watch[k];
        const double g = c->work.g[k];
        missed |= past(w, g) >= 0.0;
        if (SYSTEM.kind(&SYSTEM, HELD(c), k) != EITHER)
            w->level = larger(w->margin, smaller(w->level, g + w->margin));
        else if (g < -0.5 * w->margin && w->level > 0.0)
            w->undecided = 0;
    }
    return missed;
}

#endif
