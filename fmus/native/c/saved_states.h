/* Saved states, also as bytes. */
#ifndef SAVED_STATES_H
#define SAVED_STATES_H

#include "instance.h"

typedef struct {
    char mark[8];
    uint64_t model; /* identifies the FMU and the kind of simulation */
    uint64_t check; /* hash of the bytes that follow */
    uint64_t size;
} Header;

static const char MARK[8] = {'b', 's', 's', 't', 'a', 't', 'e', '1'};

/* FNV-1a */
static uint64_t hash(const void *data, size_t n)
{
    const unsigned char *bytes = data;
    uint64_t value = 14695981039346656037u;
    for (size_t k = 0; k < n; k++)
        value = (value ^ bytes[k]) * 1099511628211u;
    return value;
}

static uint64_t model_hash(const Instance *c)
{
    return hash(TOKEN, strlen(TOKEN)) + (uint64_t)c->exchange;
}

static Kept *find_kept(Instance *c, const void *state)
{
    for (Kept *k = c->kept; k; k = k->next) {
        if (k == state)
            return k;
    }
    refuse(c, state ? "this is no saved state of this instance" : "a null pointer was given for a "
                                                                   "saved state");
    return NULL;
}

static Kept *keep(Instance *c)
{
    Kept *k = calloc(1, sizeof *k + SAVED_BYTES);
    if (!k) {
        refuse(c, "there is no memory for a saved state");
        return NULL;
    }
    k->saved = (Saved *)(k + 1);
    k->next = c->kept;
    c->kept = k;
    return k;
}

static Status save_state(Instance *c, void **state)
{
    if (!state)
        return refuse(c, "a null pointer was given for a saved state");
    Kept *k = *state ? find_kept(c, *state) : keep(c);
    if (!k)
        return ERROR;
    if (!take_history(&k->history, c->history, DELAYS > 0 ? c->history[ROOM] : 0.0))
        return refuse(c, "there is no memory for a saved state");
    memcpy(k->saved, c->now, SAVED_BYTES);
    *state = k;
    return OK;
}

static Status restore_state(Instance *c, const void *state)
{
    const Kept *k = find_kept(c, state);
    if (!k)
        return ERROR;
    if (!remember(c, k->history, DELAYS > 0 ? k->history[ROOM] : 0.0))
        return refuse(c, "there is no memory for what delayed signals were");
    memcpy(c->now, k->saved, SAVED_BYTES);
    scale_tolerances(c);
    c->stale = 1;
    return OK;
}

static Status forget_state(Instance *c, void **state)
{
    if (!state)
        return refuse(c, "a null pointer was given for a saved state");
    if (!*state)
        return OK;
    Kept *found = find_kept(c, *state);
    if (!found)
        return ERROR;
    Kept **link = &c->kept;
    while (*link != found)
        link = &(*link)->next;
    *link = found->next;
    free(found->history);
    free(found);
    *state = NULL;
    return OK;
}

static Status serialized_size(Instance *c, const void *state, size_t *size)
{
    const Kept *k = find_kept(c, state);
    if (!k)
        return ERROR;
    if (!size)
        return refuse(c, "a null pointer was given for a size");
    *size = sizeof(Header) + SAVED_BYTES + bytes_of(k->history);
    return OK;
}

static Status serialize_state(Instance *c, const void *state, void *bytes, size_t size)
{
    const Kept *k = find_kept(c, state);
    if (!k)
        return ERROR;
    Header header = {.model = model_hash(c), .size = SAVED_BYTES + bytes_of(k->history)};
    if (!bytes || size < sizeof header + header.size)
        return refuse(c, "%lu bytes were given for a state%s, expected %lu", (unsigned long)size,
                      bytes ? "" : " by a null pointer",
                      (unsigned long)(sizeof header + header.size));
    memcpy(header.mark, MARK, sizeof header.mark);
    char *body = (char *)bytes + sizeof header;
    memcpy(body, k->saved, SAVED_BYTES);
    if (DELAYS > 0)
        memcpy(body + SAVED_BYTES, k->history, bytes_of(k->history));
    header.check = hash(body, header.size);
    memcpy(bytes, &header, sizeof header);
    return OK;
}

static Status deserialize_state(Instance *c, const void *bytes, size_t size, void **state)
{
    Header header;
    const size_t least = SAVED_BYTES + (DELAYS > 0 ? HISTORY_BYTES(0) : 0);
    double room = 0.0;
    if (!bytes || !state)
        return refuse(c, "a null pointer was given for a serialized state");
    const char *body = (const char *)bytes + sizeof header;
    if (size < sizeof header + least)
        return refuse(c, "%lu bytes are no serialized state of this FMU, which has %lu",
                      (unsigned long)size, (unsigned long)(sizeof header + least));
    memcpy(&header, bytes, sizeof header);
    if (memcmp(header.mark, MARK, sizeof header.mark) || header.model != model_hash(c) ||
        header.size < least || header.size > size - sizeof header ||
        header.check != hash(body, header.size))
        return refuse(c, "these bytes are no serialized state of this FMU, or are damaged");
    Kept *k = *state ? find_kept(c, *state) : keep(c);
    if (!k)
        return ERROR;
    if (DELAYS > 0)
        memcpy(&room, body + SAVED_BYTES + ROOM * sizeof room, sizeof room);
    if (!take_history(&k->history, NULL, room))
        return refuse(c, "there is no memory for a saved state");
    memcpy(k->saved, body, SAVED_BYTES);
    if (DELAYS > 0)
        memcpy(k->history, body + SAVED_BYTES, bytes_of(k->history));
    *state = k;
    return OK;
}

#endif
