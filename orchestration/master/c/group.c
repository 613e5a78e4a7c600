/* Connected FMU instances as one instance, with the signatures of FMI functions, see `group.py`. */
#include <stdlib.h>

typedef struct {
    Calls calls;
    Places sources; /* place of the source of each input among the group's values */
    int64_t first;  /* place of its first output among them */
} Member;

typedef struct {
    Slots parts;          /* in the order of the signals */
    Slots there, back;    /* in the two alternating orders of the steps */
    Vector values;        /* inputs of the group, then outputs of the members */
    Places flags;         /* whether outputs are outdated, and the next step is in reverse */
    int64_t lags;         /* whether outputs are outdated after every step */
} Group;

#define GROUP_FAILED 3 /* fmi2Error */

enum { STALE, BACK };

static int feed_member(Group *g, Member *m)
{
    for (int64_t k = 0; k < m->sources.size; k++)
        m->calls.given.at[k] = g->values.at[m->sources.at[k]];
    return put(&m->calls);
}

static int read_member(Group *g, Member *m)
{
    return take_all(&m->calls, g->values.at + m->first);
}

static int swept(Group *g)
{
    for (int64_t k = 0; k < g->parts.size; k++) {
        Member *const m = g->parts.at[k];
        TRY(feed_member(g, m) && read_member(g, m));
    }
    g->flags.at[STALE] = 0;
    return 1;
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
    if (g->flags.at[STALE] && !swept(g))
        return GROUP_FAILED;
    for (size_t k = 0; k < count; k++)
        values[k] = g->values.at[places[k]];
    return 0;
}

API int group_do_step(Group *g, double t, double h, int no_way_back)
{
    (void)no_way_back;
    const Slots *const order = g->flags.at[BACK] ? &g->back : &g->there;
    for (int64_t k = 0; k < order->size; k++) {
        Member *const m = order->at[k];
        if (!feed_member(g, m) || !move(&m->calls, t, h) || !read_member(g, m))
            return GROUP_FAILED;
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

API int group_get_state(Group *g, void **state)
{
    const size_t count = (size_t)g->parts.size;
    if (!*state && !(*state = calloc(1, sizeof(GroupState) + count * sizeof(void *) +
                                            (size_t)g->values.size * sizeof(double))))
        return GROUP_FAILED;
    GroupState *const s = *state;
    for (size_t k = 0; k < count; k++) {
        if (!save_as(&((Member *)g->parts.at[k])->calls, s->of_members + k))
            return GROUP_FAILED;
    }
    memcpy(s->flags, g->flags.at, sizeof s->flags);
    copy(g->values.at, values_of(g, s), g->values.size);
    return 0;
}

API int group_set_state(Group *g, void *state)
{
    GroupState *const s = state;
    for (int64_t k = 0; k < g->parts.size; k++) {
        if (!restore_from(&((Member *)g->parts.at[k])->calls, s->of_members[k]))
            return GROUP_FAILED;
    }
    memcpy(g->flags.at, s->flags, sizeof s->flags);
    copy(values_of(g, s), g->values.at, g->values.size);
    return 0;
}

API int group_free_state(Group *g, void **state)
{
    GroupState *const s = *state;
    for (int64_t k = 0; s && k < g->parts.size; k++) {
        Calls *const c = &((Member *)g->parts.at[k])->calls;
        if (s->of_members[k])
            c->free_state(c->component, s->of_members + k);
    }
    free(s);
    *state = NULL;
    return 0;
}
