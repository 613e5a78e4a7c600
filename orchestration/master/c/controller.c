/* A controller as a function: its commands, and their derivatives, for given signals. A *law* is one
 * array, in the order of the ports that it is read from: m commands, their derivatives by n signals
 * each, their own rates. */
#include "calls.h"

#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

enum { DIRECT, STEPPED, SAMPLED };       /* when commands respond, see `coupling.Answer` */
enum { CORRECTION, PROBE, AHEAD, USES };       /* uses of saved states */

#define PROBE_PARTS 64

/* Inputs: n signals, references; outputs: m commands, then gains and rates if it reports a law, and
 * others that are only recorded. A group gets the present signals before the others are read. */
typedef struct {
    Calls calls;
    int64_t m, n, others, group, answer, reports, saves, varies;
    Vector nominal, real;   /* of the signals; whether each signal and reference is Real */
    Vector ahead;           /* commands after a step that cannot be taken back */
    int64_t is_ahead;       /* whether it has done such a step */
    Vector tried;           /* time, length and inputs of the step whose end is saved as AHEAD */
    Vector moved, answered; /* room for n signals and m commands */
} Controller;

static int differ(const double *a, const double *b, int64_t count)
{
    while (count > 0 && a[count - 1] == b[count - 1])
        count--;
    return count > 0;
}

API int master_set_inputs(Controller *c, const double *signals, const double *reference)
{
    copy(signals, c->calls.given.at, c->n);
    copy(reference, c->calls.given.at + c->n, c->calls.given.size - c->n);
    return put(&c->calls);
}

/* The present commands. */
API int master_read_commands(Controller *c, double *commands)
{
    TRY(take(&c->calls, c->m));
    copy(c->calls.taken.at, commands, c->m);
    return 1;
}

API int master_command_at(Controller *c, const double *signals, const double *reference,
                          double *commands)
{
    return master_set_inputs(c, signals, reference) && master_read_commands(c, commands);
}

/* The commands at these signals, at once or after a step. */
static int answer_at(Controller *c, double t, double h, const double *signals,
                     const double *reference, double *commands)
{
    TRY(master_set_inputs(c, signals, reference));
    if (c->answer != DIRECT && !at_end(&c->calls, t))
        TRY(move(&c->calls, t, h));
    return master_read_commands(c, commands);
}

/* Derivatives of the commands by the signals, by differences from the law's commands. */
API int master_probe_gains(Controller *c, double t, double h, const double *signals,
                           const double *reference, double *law)
{
    double *const moved = c->moved.at, *const commands = c->answered.at;
    copy(signals, moved, c->n);
    for (int64_t j = 0; j < c->n; j++) {
        if (!c->real.at[j])
            continue;
        moved[j] += 1e-7 * fmax(fabs(signals[j]), 1e-3 * c->nominal.at[j]);
        TRY(answer_at(c, t, h, moved, reference, commands));
        TRY(c->answer == DIRECT || restore(&c->calls, PROBE));
        for (int64_t k = 0; k < c->m; k++)
            law[c->m + k * c->n + j] = (commands[k] - law[k]) / (moved[j] - signals[j]);
        moved[j] = signals[j];
    }
    return 1;
}

/* Move the controller from t to t + h with these signals held, if it has not tried just that. */
API int master_advance(Controller *c, double t, double h, const double *signals,
                       const double *reference)
{
    if (c->is_ahead) {
        c->is_ahead = 0;
        return 1;
    }
    TRY(master_set_inputs(c, signals, reference));
    const double *const tried = c->tried.at; /* its length is 0 if there is none */
    const int same = tried[0] == t && tried[1] == h;
    if (same && !differ(tried + 2, c->calls.given.at, c->calls.given.size))
        return restore(&c->calls, AHEAD);
    return move(&c->calls, t, h);
}

/* The law of a controller that answers in its step. */
static int stepped_law(Controller *c, double t, double h, const double *signals,
                       const double *reference, int probe, double *law)
{
    if (!c->saves) {
        if (!c->is_ahead)
            TRY(master_advance(c, t, h, signals, reference) && master_read_commands(c, c->ahead.at));
        c->is_ahead = 1;
        copy(c->ahead.at, law, c->m);
        return 1;
    }
    TRY(save(&c->calls, PROBE) && answer_at(c, t, h, signals, reference, law));
    release(&c->calls, AHEAD);
    TRY(save(&c->calls, AHEAD) && restore(&c->calls, PROBE));
    copy((double[]){t, at_end(&c->calls, t) ? 0.0 : h}, c->tried.at, 2);
    copy(c->calls.given.at, c->tried.at + 2, c->calls.given.size);
    if (probe && c->answer == STEPPED)
        TRY(master_probe_gains(c, t, h, signals, reference, law));
    release(&c->calls, PROBE);
    return 1;
}

/* The rates of the commands with held signals: the slope at the start. The secant would give the
 * right command at the end of the step, and the error in between would not show in the residual. */
static int probe_rates(Controller *c, double t, double h, const double *signals,
                       const double *reference, double *law)
{
    double *const rate = law + c->m * (1 + c->n);
    if (!c->varies || at_end(&c->calls, t))
        return 1;
    TRY(save(&c->calls, PROBE) && master_set_inputs(c, signals, reference));
    TRY(move(&c->calls, t, h / PROBE_PARTS) && master_command_at(c, signals, reference, rate));
    for (int64_t k = 0; k < c->m; k++)
        rate[k] = (rate[k] - law[k]) * PROBE_PARTS / h;
    TRY(restore(&c->calls, PROBE));
    release(&c->calls, PROBE);
    return 1;
}

/* Put the commands at the given signals, and with `probe` their derivatives, into `law`. A controller
 * that answers in its step and cannot save its state has moved then; see `master_advance`. */
API int master_law_at(Controller *c, double t, double h, const double *signals,
                      const double *reference, int probe, double *law)
{
    const int64_t m = c->m, size = m * (2 + c->n);
    if (c->answer == DIRECT && c->reports && probe) {
        TRY(master_set_inputs(c, signals, reference) && take(&c->calls, size));
        copy(c->calls.taken.at, law, size);
        return 1;
    }
    memset(law + m, 0, (size_t)(size - m) * sizeof *law);
    if (c->answer != DIRECT)
        return stepped_law(c, t, h, signals, reference, probe, law);
    TRY(master_command_at(c, signals, reference, law));
    if (!probe)
        return 1;
    TRY(master_probe_gains(c, t, h, signals, reference, law));
    if (c->saves)
        TRY(probe_rates(c, t, h, signals, reference, law));
    return master_set_inputs(c, signals, reference);
}
