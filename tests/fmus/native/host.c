/* A host without Python: loads an FMU of FMI 2.0, runs it, saves, restores, serializes, resets and
 * frees it, and prints outputs at every communication point as hexadecimal numbers.
 *
 * host LIBRARY GUID STEPS STEP INPUT VALUE OUTPUT...
 *
 * INPUT and OUTPUT are value references; the input has its value from the start on. */
#define _GNU_SOURCE
#ifdef _WIN32
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FIND_IN(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#define CLOSE(library) FreeLibrary((HMODULE)(library))
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define FIND_IN(library, name) dlsym(library, name)
#define CLOSE(library) dlclose(library)
#endif
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST 16

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

static void *library, *instance;
static unsigned input, outputs[MOST];
static size_t output_count;
static double value;

static struct {
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    void (*free_instance)(void *);
    int (*setup)(void *, int, double, double, int, double);
    int (*enter)(void *), (*leave)(void *), (*terminate)(void *), (*reset)(void *);
    int (*set)(void *, const unsigned *, size_t, const double *);
    int (*get)(void *, const unsigned *, size_t, double *);
    int (*step)(void *, double, double, int);
    int (*save)(void *, void **), (*restore)(void *, void *), (*forget)(void *, void **);
    int (*size)(void *, void *, size_t *);
    int (*pack)(void *, void *, char *, size_t), (*unpack)(void *, const char *, size_t, void **);
} fmu;

static void must(int wrong, const char *what)
{
    if (wrong) {
        fprintf(stderr, "host: %s\n", what);
        exit(1);
    }
}

static void hear(void *environment, const char *name, int status, const char *category,
                 const char *message, ...)
{
    (void)environment;
    (void)category;
    (void)status;
    fprintf(stderr, "%s: %s\n", name, message);
}

static void load(const char *path)
{
    library = OPEN(path);
    must(!library, "the library does not load");
#define FIND(member, name)                                                                         \
    do {                                                                                           \
        *(void **)&fmu.member = FIND_IN(library, "fmi2" name);                                     \
        must(!fmu.member, "no fmi2" name);                                                         \
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
    FIND(step, "DoStep");
    FIND(save, "GetFMUstate");
    FIND(restore, "SetFMUstate");
    FIND(forget, "FreeFMUstate");
    FIND(size, "SerializedFMUstateSize");
    FIND(pack, "SerializeFMUstate");
    FIND(unpack, "DeSerializeFMUstate");
}

static void initialize(void)
{
    must(fmu.setup(instance, 0, 0.0, 0.0, 0, 0.0), "setup");
    must(fmu.set(instance, &input, 1, &value), "set");
    must(fmu.enter(instance), "enter initialization");
    must(fmu.leave(instance), "leave initialization");
}

static void run(long first, long last, double h, double *rows)
{
    for (long k = first; k < last; k++) {
        must(fmu.step(instance, (double)k * h, h, 0), "step");
        must(fmu.get(instance, outputs, output_count, rows + (size_t)k * output_count), "get");
    }
}

int main(int argc, char **argv)
{
    const Callbacks callbacks = {hear, calloc, free, NULL, NULL};
    void *saved = NULL, *unpacked = NULL;
    must(argc < 8 || argc > 7 + MOST, "seven arguments or more are needed");
    const long steps = strtol(argv[3], NULL, 10), half = steps / 2;
    const double h = strtod(argv[4], NULL);
    input = (unsigned)strtoul(argv[5], NULL, 10);
    value = strtod(argv[6], NULL);
    for (int k = 7; k < argc; k++)
        outputs[output_count++] = (unsigned)strtoul(argv[k], NULL, 10);
    const size_t n = (size_t)steps * output_count, bytes = n * sizeof(double);
    double *first = calloc(n, sizeof *first), *again = calloc(n, sizeof *again);

    load(argv[1]);
    must(fmu.instantiate("one", 1, "{another}", NULL, &callbacks, 0, 1) != NULL, "a wrong guid");
    instance = fmu.instantiate("one", 1, argv[2], NULL, &callbacks, 0, 1);
    must(!instance, "no instance");
    initialize();
    run(0, half, h, first);
    must(fmu.save(instance, &saved), "save");
    size_t size;
    must(fmu.size(instance, saved, &size), "size");
    char *packed = malloc(size);
    must(fmu.pack(instance, saved, packed, size), "serialize");
    run(half, steps, h, first);
    memcpy(again, first, bytes);
    must(fmu.restore(instance, saved), "restore");
    run(half, steps, h, again);
    must(memcmp(first, again, bytes), "a restored state goes on in another way");
    must(fmu.unpack(instance, packed, size, &unpacked), "deserialize");
    must(fmu.restore(instance, unpacked), "restore");
    run(half, steps, h, again);
    must(memcmp(first, again, bytes), "a deserialized state goes on in another way");
    must(fmu.forget(instance, &saved), "free a state"); /* the other is left */
    must(fmu.reset(instance), "reset");
    initialize();
    run(0, steps, h, again);
    must(memcmp(first, again, bytes), "a reset instance goes another way");
    must(fmu.terminate(instance), "terminate");
    fmu.free_instance(instance);
    CLOSE(library);
    for (size_t k = 0; k < n; k++)
        printf("%.13a%c", first[k], (k + 1) % output_count ? ' ' : '\n');
    free(packed);
    free(first);
    free(again);
    return 0;
}
