/* A host without Python: loads a plant and a controller as FMI 2.0 FMUs, runs them as a loop, saves,
 * restores, resets and frees them, and prints the plant's outputs at every communication point as
 * hexadecimal floating point numbers.
 *
 * host PLANT_LIBRARY PLANT_GUID CONTROLLER_LIBRARY CONTROLLER_GUID WIRING STEPS STEP
 *
 * Lines of WIRING: "w SOURCE REFERENCE SINK REFERENCE" connects, "s INSTANCE REFERENCE VALUE" sets
 * before initialization, "o REFERENCE" prints an output of the plant; 0 is the plant. */
#define _GNU_SOURCE
#ifdef _WIN32
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FIND_IN(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#define CLOSE(library) FreeLibrary((HMODULE)(library))
#define WHY "the library does not load"
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define FIND_IN(library, name) dlsym(library, name)
#define CLOSE(library) dlclose(library)
#define WHY dlerror()
#endif
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

typedef struct {
    void *library;
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    void (*free_instance)(void *);
    int (*setup)(void *, int, double, double, int, double);
    int (*enter)(void *), (*leave)(void *), (*terminate)(void *), (*reset)(void *);
    int (*set)(void *, const unsigned *, size_t, const double *);
    int (*get)(void *, const unsigned *, size_t, double *);
    int (*text)(void *, const unsigned *, size_t, const char **);
    int (*step)(void *, double, double, int);
    int (*save)(void *, void **), (*restore)(void *, void *), (*forget)(void *, void **);
    int (*size)(void *, void *, size_t *);
    int (*pack)(void *, void *, char *, size_t), (*unpack)(void *, const char *, size_t, void **);
    int (*derivative)(void *, const unsigned *, size_t, const unsigned *, size_t, const double *,
                      double *);
    int (*states)(void *, double *, size_t), (*slopes)(void *, double *, size_t);
    int (*set_states)(void *, const double *, size_t), (*time)(void *, double);
    int (*update)(void *, void *), (*go_on)(void *);
} Fmu;

typedef struct {
    unsigned source, from, sink, to;
} Wire;

typedef struct {
    unsigned instance, reference;
    double value;
} Start;

static Fmu fmus[2];
static void *instances[2];
static Wire wires[64];
static Start starts[64];
static unsigned outputs[64];
static size_t wire_count, start_count, output_count;
static int complaints;

static void fail(const char *what)
{
    fprintf(stderr, "host: %s\n", what);
    exit(1);
}

static void must(int status, const char *what)
{
    if (status)
        fail(what);
}

static void hear(void *environment, const char *name, int status, const char *category,
                 const char *message, ...)
{
    (void)environment;
    (void)category;
    (void)status;
    complaints++;
    fprintf(stderr, "%s: %s\n", name, message);
}

static void load(Fmu *fmu, const char *path)
{
    fmu->library = OPEN(path);
    if (!fmu->library)
        fail(WHY);
#define FIND(member, name)                                                                         \
    do {                                                                                           \
        *(void **)&fmu->member = FIND_IN(fmu->library, "fmi2" name);                                 \
        if (!fmu->member)                                                                          \
            fail("no fmi2" name);                                                                  \
    } while (0)
    FIND(instantiate, "Instantiate");
    FIND(free_instance, "FreeInstance");
    FIND(setup, "SetupExperiment");
    FIND(enter, "EnterInitializationMode");
    FIND(leave, "ExitInitializationMode");
    FIND(terminate, "Terminate");
    FIND(reset, "Reset");
    FIND(set, "SetReal");
    FIND(get, "GetReal");
    FIND(text, "GetString");
    FIND(step, "DoStep");
    FIND(save, "GetFMUstate");
    FIND(restore, "SetFMUstate");
    FIND(forget, "FreeFMUstate");
    FIND(size, "SerializedFMUstateSize");
    FIND(pack, "SerializeFMUstate");
    FIND(unpack, "DeSerializeFMUstate");
    FIND(derivative, "GetDirectionalDerivative");
    FIND(states, "GetContinuousStates");
    FIND(slopes, "GetDerivatives");
    FIND(set_states, "SetContinuousStates");
    FIND(time, "SetTime");
    FIND(update, "NewDiscreteStates");
    FIND(go_on, "EnterContinuousTimeMode");
}

static void read_wiring(const char *path)
{
    FILE *file = fopen(path, "r");
    char kind;
    if (!file)
        fail("cannot read the wiring");
    while (fscanf(file, " %c", &kind) == 1) {
        Wire *w = &wires[wire_count];
        Start *s = &starts[start_count];
        int read = 0;
        if (wire_count == 64 || start_count == 64 || output_count == 64)
            fail("too much wiring");
        if (kind == 'w') {
            read = fscanf(file, "%u %u %u %u", &w->source, &w->from, &w->sink, &w->to) == 4;
            wire_count++;
        } else if (kind == 's') {
            read = fscanf(file, "%u %u %lf", &s->instance, &s->reference, &s->value) == 3;
            start_count++;
        } else if (kind == 'o') {
            read = fscanf(file, "%u", &outputs[output_count++]) == 1;
        }
        if (!read)
            fail("the wiring has a line that cannot be read");
    }
    fclose(file);
}

static void exchange_signals(void)
{
    double values[64];
    for (size_t k = 0; k < wire_count; k++)
        must(fmus[wires[k].source].get(instances[wires[k].source], &wires[k].from, 1, &values[k]),
             "get");
    for (size_t k = 0; k < wire_count; k++)
        must(fmus[wires[k].sink].set(instances[wires[k].sink], &wires[k].to, 1, &values[k]), "set");
}

static void initialize(void)
{
    for (int i = 0; i < 2; i++)
        must(fmus[i].setup(instances[i], 0, 0.0, 0.0, 0, 0.0), "setup");
    for (size_t k = 0; k < start_count; k++)
        must(fmus[starts[k].instance].set(instances[starts[k].instance], &starts[k].reference, 1,
                                          &starts[k].value), "start value");
    for (int i = 0; i < 2; i++)
        must(fmus[i].enter(instances[i]), "enter initialization");
    exchange_signals();
    exchange_signals();
    for (int i = 0; i < 2; i++)
        must(fmus[i].leave(instances[i]), "leave initialization");
}

/* A Jacobi master; rows of outputs from step `first` on. */
static void run(long first, long last, double h, double *rows)
{
    for (long k = first; k < last; k++) {
        exchange_signals();
        for (int i = 0; i < 2; i++)
            must(fmus[i].step(instances[i], (double)k * h, h, 0), "step");
        must(fmus[0].get(instances[0], outputs, output_count, rows + (size_t)k * output_count),
             "get");
    }
}

static void same(const double *a, const double *b, size_t n, const char *what)
{
    if (memcmp(a, b, n * sizeof *a))
        fail(what);
}

/* Euler's steps through the model-exchange interface, and calls that it must refuse. */
static void exchange(const char *guid, const Callbacks *callbacks)
{
    Fmu *fmu = &fmus[0];
    void *instance = fmu->instantiate("exchange", 0, guid, NULL, callbacks, 0, 1);
    double states[64], slopes[64], one = 1.0, slope;
    int info[16];
    size_t n = 0;
    if (!instance)
        fail("no instance for model exchange");
    must(fmu->setup(instance, 1, 1e-6, 0.0, 1, 1.0), "setup");
    must(fmu->enter(instance), "enter");
    must(fmu->leave(instance), "leave");
    must(fmu->update(instance, info), "new discrete states");
    must(fmu->go_on(instance), "continuous time");
    complaints = 0;
    while (n < 64 && fmu->states(instance, states, n))
        n++;
    if (complaints != (int)n)
        fail("a wrong number of states was refused without a word");
    for (int k = 0; k < 100; k++) {
        must(fmu->time(instance, 1e-6 * k), "time");
        must(fmu->states(instance, states, n), "states");
        must(fmu->slopes(instance, slopes, n), "derivatives");
        for (size_t i = 0; i < n; i++)
            states[i] += 1e-6 * slopes[i];
        must(fmu->set_states(instance, states, n), "states");
    }
    must(fmu->derivative(instance, &outputs[0], 1, &outputs[0], 1, &one, &slope), "derivative");
    if (slope != 1.0)
        fail("a state is not its own derivative by itself");
    if (!fmu->step(instance, 0.0, 1e-3, 0) || !fmu->get(instance, NULL, 1, states))
        fail("what makes no sense was not refused");
    must(fmu->terminate(instance), "terminate");
    fmu->free_instance(instance);
}

int main(int argc, char **argv)
{
    const Callbacks callbacks = {hear, calloc, free, NULL, NULL};
    static const char *const names[] = {"plant", "controller"};
    if (argc != 8)
        fail("seven arguments are needed");
    const long steps = strtol(argv[6], NULL, 10), half = steps / 2;
    const double h = strtod(argv[7], NULL);
    for (int i = 0; i < 2; i++) {
        load(&fmus[i], argv[1 + 2 * i]);
        if (fmus[i].instantiate(names[i], 1, "{another}", NULL, &callbacks, 0, 1))
            fail("a wrong guid was taken");
        instances[i] = fmus[i].instantiate(names[i], 1, argv[2 + 2 * i], NULL, &callbacks, 0, 1);
        if (!instances[i])
            fail("no instance");
    }
    read_wiring(argv[5]);
    const size_t n = (size_t)steps * output_count;
    double *first = calloc(n, sizeof *first), *again = calloc(n, sizeof *again);

    initialize();
    run(0, half, h, first);
    void *saved[2] = {NULL, NULL}, *unpacked[2] = {NULL, NULL};
    char *bytes[2];
    size_t sizes[2];
    for (int i = 0; i < 2; i++) {
        must(fmus[i].save(instances[i], &saved[i]), "save");
        must(fmus[i].size(instances[i], saved[i], &sizes[i]), "size");
        bytes[i] = malloc(sizes[i]);
        must(fmus[i].pack(instances[i], saved[i], bytes[i], sizes[i]), "serialize");
    }
    run(half, steps, h, first);
    memcpy(again, first, n * sizeof *first);
    for (int i = 0; i < 2; i++)
        must(fmus[i].restore(instances[i], saved[i]), "restore");
    run(half, steps, h, again);
    same(first, again, n, "a restored state goes on in another way");
    for (int i = 0; i < 2; i++) {
        must(fmus[i].unpack(instances[i], bytes[i], sizes[i], &unpacked[i]), "deserialize");
        must(fmus[i].restore(instances[i], unpacked[i]), "restore");
        free(bytes[i]);
    }
    run(half, steps, h, again);
    same(first, again, n, "a deserialized state goes on in another way");
    for (int i = 0; i < 2; i++) {
        must(fmus[i].forget(instances[i], &saved[i]), "free a state"); /* the other is left */
        must(fmus[i].reset(instances[i]), "reset");
    }
    initialize();
    run(0, steps, h, again);
    same(first, again, n, "a reset instance goes another way");
    exchange(argv[2], &callbacks);
    for (int i = 0; i < 2; i++) {
        must(fmus[i].terminate(instances[i]), "terminate");
        fmus[i].free_instance(instances[i]);
        CLOSE(fmus[i].library);
    }
    for (size_t k = 0; k < n; k++)
        printf("%.13a%c", first[k], (k + 1) % output_count ? ' ' : '\n');
    free(first);
    free(again);
    return 0;
}
