/* Connected FMU instances as one instance, with the signatures of FMI functions, see `group.py`. */
#include <stdlib.h>

typedef struct {
    Calls calls;
    Places sources; /* place of the source of each input among the group's values */
    int64_t first;  /* place of its first output among them */
    int64_t follows; /* whether outputs may follow inputs without a step */
} Member;

typedef struct {
    Slots parts;          /* in the order of the signals */
    Slots there, back;    /* in the two alternating orders of the steps */
    Vector values;        /* inputs of the group, then outputs of the members */
    Places flags;         /* whether outputs are outdated, and the next step is in reverse */
    int64_t lags;         /* whether outputs are outdated after every step */
} Group;

#define CALL_FAILED 3 /* fmi2Error */

enum { STALE, BACK };

/* Set a member's inputs, and read its outputs, after a step if it is one. */
static int pass_on(Group *g, Member *m, int steps, double t, double h)
{
    for (int64_t k = 0; k < m->sources.size; k++)
        m->calls.given.at[k] = g->values.at[m->sources.at[k]];
    TRY(put(&m->calls) && (!steps || move(&m->calls, t, h)));
    return take_all(&m->calls, g->values.at + m->first);
}

API int group_set_real(Group *g, const uint32_t *places, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++)
        g->values.at[places[k]] = values[k];
    g->flags.at[STALE] = 1;
    return 0;
}

API int group_get_real(Group *g, const uint32_t *places, size_t count, double *values)
{
    for (int64_t k = 0; k < g->parts.size && g->flags.at[STALE]; k++) {
        Member *const m = g->parts.at[k];
        if (m->follows && !pass_on(g, m, 0, 0.0, 0.0))
            return CALL_FAILED;
    }
    g->flags.at[STALE] = 0;
    for (size_t k = 0; k < count; k++)
        values[k] = g->values.at[places[k]];
    return 0;
}

API int group_do_step(Group *g, double t, double h, int no_way_back)
{
    const Slots *const order = g->flags.at[BACK] ? &g->back : &g->there;
    for (int64_t k = 0; k < order->size; k++) {
        if (!pass_on(g, order->at[k], 1, t, h))
            return CALL_FAILED;
    }
    g->flags.at[BACK] = !g->flags.at[BACK];
    g->flags.at[STALE] = g->lags;
    return 0;
}

/* A saved state: flags, states of the members, and the values. */
typedef struct {
    int64_t flags[2];
    void *of_members[];
} GroupState;

static double *values_of(const Group *g, GroupState *s)
{
    return (double *)(s->of_members + g->parts.size);
}

/* A member, whose states are those in a state of the group: its own is the k-th. */
static Calls *member_in(const Group *g, GroupState *s, int64_t k)
{
    Calls *const c = &((Member *)g->parts.at[k])->calls;
    c->states.at = s->of_members;
    c->states.size = g->parts.size;
    return c;
}

API int group_get_state(Group *g, void **state)
{
    const size_t count = (size_t)g->parts.size, values = (size_t)g->values.size;
    const size_t size = sizeof(GroupState) + count * sizeof(void *) + values * sizeof(double);
    if (!*state && !(*state = calloc(1, size)))
        return CALL_FAILED;
    GroupState *const s = *state;
    for (int64_t k = 0; k < g->parts.size; k++) {
        if (!save(member_in(g, s, k), k))
            return CALL_FAILED;
    }
    memcpy(s->flags, g->flags.at, sizeof s->flags);
    copy(g->values.at, values_of(g, s), g->values.size);
    return 0;
}

API int group_set_state(Group *g, void *state)
{
    GroupState *const s = state;
    for (int64_t k = 0; k < g->parts.size; k++) {
        if (!restore(member_in(g, s, k), k))
            return CALL_FAILED;
    }
    memcpy(g->flags.at, s->flags, sizeof s->flags);
    copy(values_of(g, s), g->values.at, g->values.size);
    return 0;
}

API int group_free_state(Group *g, void **state)
{
    for (int64_t k = 0; *state && k < g->parts.size; k++)
        release(member_in(g, *state, k), k);
    free(*state);
    *state = NULL;
    return 0;
}
