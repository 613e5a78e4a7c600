/* An FMU in another process, which is not trusted: its functions here, and what answers there.
 * Calls without a result wait for one with a result: one array of doubles, led by its length. */

enum { REMOTE_SET, REMOTE_STEP, REMOTE_SAVE, REMOTE_RESTORE, REMOTE_FREE, REMOTE_GET };
enum { ENDED = 1, NOT_UNDERSTOOD }; /* how a connection was lost */

/* A connection, with the calls that wait, after room for their length. */
typedef struct {
    int64_t socket, used; /* used: length of these calls */
    int (*wait)(int goes_on); /* waits in Python, which hears interrupts; 0: an answer is there */
    int64_t changes;          /* number of calls that may have changed outputs */
    int64_t lost, states;     /* how it was lost; a bit for each saved state */
    Vector room;
} Line;

/* An instance on the other side, with some ports. */
typedef struct {
    Line *line;
    int64_t number;        /* of these ports, on the other side */
    int64_t read_at, set_at; /* `changes` when outputs were read, and up to which inputs stay */
    Vector known, given;     /* these outputs and inputs */
} Remote;

/* The other side: records of type Calls by their number. */
typedef struct {
    int64_t socket, asked; /* number of the ports of the last call */
    Slots calls;
    Vector room;
} Served;

#define MOST_STATES 60
#define CALL 3          /* kind, number of the ports, number of values */
#define ANSWER 2        /* length, status */
#define PATIENCE 20     /* ms, after which Python waits */

enum { LOOKS = 200, LATE = 100, WAITS = 1000 }; /* number, us, number; see `remote_look` */

#include <sys/time.h>
#ifdef _WIN32
#include <winsock2.h>
#define poll WSAPoll
#define MSG_NOSIGNAL 0
#define sched_yield SwitchToThread
typedef SOCKET Socket;
static int is_final(void) { return WSAGetLastError() != WSAEWOULDBLOCK; }
#else
#include <errno.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
typedef int Socket;
static int is_final(void) { return errno != EINTR && errno != EAGAIN; }
#endif

/* Whether there is a message. To wake a processor takes longer than to look for one some times; but
 * where others compute, too, they get their share of the time, and a look is late: then the next
 * waits are without looking. */
static int remote_look(Socket socket)
{
    static int shared = 0; /* number of these */
    struct pollfd message = {socket, POLLIN, 0};
    shared -= shared > 0;
    for (int k = 0; k < LOOKS && !shared; k++) {
        struct timeval before, after;
        if (poll(&message, 1, 0) > 0)
            return 1;
        gettimeofday(&before, NULL);
        sched_yield();
        gettimeofday(&after, NULL);
        if ((after.tv_sec - before.tv_sec) * 1000000 + after.tv_usec - before.tv_usec > LATE)
            shared = WAITS;
    }
    return 0;
}

static int remote_send(Socket socket, const double *values, int64_t count)
{
    const char *at = (const char *)values, *const end = (const char *)(values + count);
    while (at < end) {
        const int64_t sent = send(socket, at, (unsigned)(end - at), MSG_NOSIGNAL);
        struct pollfd room = {socket, POLLOUT, 0};
        if (sent > 0)
            at += sent;
        else if (is_final() || poll(&room, 1, -1) < 0)
            return 0;
    }
    return 1;
}

/* Receive a message, which is led by its length, or as much as there is room for; on the master's
 * side, which has a `line`, Python waits if it takes long. */
static int remote_receive(Socket socket, Line *line, double *values, int64_t most)
{
    const int64_t size = sizeof *values;
    int64_t done = 0;
    int goes_on = 0;
    while (done < size || (done < most * size && (double)done < (double)size * values[0])) {
        struct pollfd answer = {socket, POLLIN, 0};
        if (line && !remote_look(socket) && poll(&answer, 1, PATIENCE) <= 0 && line->wait(goes_on++))
            return 0;
        const int64_t got = recv(socket, (char *)values + done, (unsigned)(most * size - done), 0);
        if (got == 0 || (got < 0 && is_final())) {
            if (line)
                line->lost = ENDED;
            return 0;
        }
        done += got > 0 ? got : 0;
    }
    return 1;
}

/* Send all calls that wait, and this one for the first outputs; return its status. */
static int remote_ask(Remote *r, int64_t count)
{
    Line *const l = r->line;
    double *const at = l->room.at, call[CALL] = {REMOTE_GET, (double)r->number, (double)count};
    if (l->lost)
        return CALL_FAILED;
    copy(call, at + 1 + l->used, CALL);
    at[0] = (double)(1 + l->used + CALL);
    l->used = 0;
    if (!remote_send((Socket)l->socket, at, (int64_t)at[0]))
        l->lost = ENDED;
    else if (remote_receive((Socket)l->socket, l, at, ANSWER + count)) {
        if (at[0] == ANSWER && at[1] > 1.0 && at[1] < 5.0)
            return (int)at[1];
        if (at[0] == (double)(ANSWER + count) && at[1] == 0.0) {
            copy(at + ANSWER, r->known.at, count);
            return 0;
        }
        l->lost = NOT_UNDERSTOOD;
    }
    return CALL_FAILED;
}

API int remote_flush(Remote *r) { return r->line->used ? remote_ask(r, 0) : 0; }

/* Note a call without a result. */
static int remote_tell(Remote *r, int kind, const double *values, size_t count)
{
    Line *const l = r->line;
    const double call[CALL] = {kind, (double)r->number, (double)count};
    if (l->used + 1 + 2 * CALL + (int64_t)count > l->room.size && remote_flush(r))
        return CALL_FAILED;
    copy(call, l->room.at + 1 + l->used, CALL);
    copy(values, l->room.at + 1 + l->used + CALL, (int64_t)count);
    l->used += CALL + (int64_t)count;
    l->changes++;
    return 0;
}

API int remote_set_real(Remote *r, const uint32_t *which, size_t count, const double *values)
{
    if (r->set_at == r->line->changes && !memcmp(values, r->given.at, count * sizeof *values))
        return 0; /* the FMU has these */
    copy(values, r->given.at, (int64_t)count);
    r->set_at = r->line->changes + 1;
    return remote_tell(r, REMOTE_SET, values, count);
}

API int remote_do_step(Remote *r, double t, double h, int forgets)
{
    r->set_at += r->set_at == r->line->changes;
    return remote_tell(r, REMOTE_STEP, (double[]){t, h}, 2);
}

/* A step begins with the end values of the last one: all are read, once. */
API int remote_get_real(Remote *r, const uint32_t *which, size_t count, double *values)
{
    Line *const l = r->line;
    if (r->read_at != l->changes || l->lost) {
        const int status = remote_ask(r, r->known.size);
        if (status)
            return status;
        r->read_at = l->changes;
    }
    copy(r->known.at, values, (int64_t)count);
    return 0;
}

API int remote_get_state(Remote *r, void **state)
{
    int64_t place = 0, *const states = &r->line->states;
    while (place < MOST_STATES && *states >> place & 1)
        place++;
    if (place == MOST_STATES)
        return CALL_FAILED;
    *states |= (int64_t)1 << place;
    *state = (char *)0 + place + 1;
    return remote_tell(r, REMOTE_SAVE, (double[]){(double)place}, 1);
}

static double place_of(const void *state) { return (double)((const char *)state - (char *)0 - 1); }

API int remote_set_state(Remote *r, void *state)
{
    return remote_tell(r, REMOTE_RESTORE, (double[]){place_of(state)}, 1);
}

API int remote_free_state(Remote *r, void **state)
{
    r->line->states &= ~((int64_t)1 << (int64_t)place_of(*state));
    return remote_tell(r, REMOTE_FREE, (double[]){place_of(*state)}, 1);
}

static void *saved_states[MOST_STATES]; /* of the one FMU of the other process */

static int remote_do(Calls *c, int kind, const double *values, int64_t count)
{
    const int keeps = kind == REMOTE_SAVE || kind == REMOTE_RESTORE || kind == REMOTE_FREE;
    void **const state = saved_states + (keeps ? (int64_t)values[0] : 0);
    switch (kind) {
    case REMOTE_SET: copy(values, c->given.at, count); return put(c);
    case REMOTE_STEP: return move(c, values[0], values[1]);
    case REMOTE_SAVE: return checked(c, c->get_state(c->component, state), SAVE);
    case REMOTE_RESTORE: return checked(c, c->set_state(c->component, *state), RESTORE);
    case REMOTE_FREE: c->free_state(c->component, state); return 1;
    default: return take(c, count);
    }
}

/* Do the calls of one message, up to the first that fails, and answer; 0 if that is impossible. */
static int remote_answer(Served *s)
{
    double *const room = s->room.at;
    Calls *c = NULL;
    int64_t count = 0;
    int done = 1;
    TRY(remote_receive((Socket)s->socket, NULL, room, s->room.size) && room[0] <= s->room.size);
    for (int64_t at = 1; done && (double)at < room[0]; at += CALL + (room[at] == REMOTE_GET ? 0 : count)) {
        s->asked = (int64_t)room[at + 1];
        c = s->calls.at[s->asked];
        count = (int64_t)room[at + 2];
        done = remote_do(c, (int)room[at], room + at + CALL, count);
    }
    room[0] = (double)(ANSWER + (done ? count : 0));
    room[1] = done ? 0.0 : (double)c->status;
    if (done && count)
        copy(c->taken.at, room + ANSWER, count);
    return remote_send((Socket)s->socket, room, (int64_t)room[0]);
}

/* Answer messages until one comes that is not for this code, or the connection is closed. */
API void remote_serve(Served *s)
{
    char first = 0; /* the length of a message is a whole number, whose last byte as a double is 0 */
    do {
        remote_look((Socket)s->socket);
        while (recv((Socket)s->socket, &first, 1, MSG_PEEK) < 0 && !is_final())
            continue;
    } while (!first && remote_answer(s));
}
