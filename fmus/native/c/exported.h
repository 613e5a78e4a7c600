/* What the functions that hosts call begin with. EXPORT(type) name: a function that hosts find.
 * Compiled into another program, its name gets the prefix FUNCTION_PREFIX. */
#ifndef EXPORTED_H
#define EXPORTED_H

#if defined _WIN32 || defined __CYGWIN__
#define EXPORT(type) __declspec(dllexport) type
#elif defined __GNUC__
#define EXPORT(type) __attribute__((visibility("default"))) type
#else
#define EXPORT(type) type
#endif

#ifdef FUNCTION_PREFIX
#define JOINED_(a, b) a##b
#define JOINED(a, b) JOINED_(a, b)
#define NAMED(name) JOINED(FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif

/* Refuse what no instance, or one in another phase, is asked for. */
#define CHECK(phases, call)                                                                        \
    Instance *c = instance;                                                                        \
    if (!c || !allowed(c, phases, call))                                                           \
        return ERROR
#define CHECK_KIND(phases, call, kind)                                                             \
    Instance *c = instance;                                                                        \
    if (c && c->exchange != (kind))                                                                \
        return refuse(c, "%s belongs to %s", call, (kind) ? "model exchange" : "co-simulation");   \
    if (!c || !allowed(c, phases, call))                                                           \
        return ERROR

#endif
