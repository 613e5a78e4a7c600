/* Loads the compiled core of a wheel and solves dx/dt = -k x, x(0) = 1, whose tapes are in a file.
 *
 * core_host LIBRARY TAPES K T  prints x(T), as hexadecimal digits, and the status. */
#include <stdio.h>
#include <stdlib.h>

#include "../../solver/c/stepper.h"
#include "../../solver/c/tape.h"

#ifdef _WIN32
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FIND(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FIND(library, name) dlsym(library, name)
#endif

#define TAPES 10
#define HEAD (6 + 2 * TAPES)
#define OPERATION 10 /* bytes */

int main(int count, char **given)
{
    if (count != 5)
        return 2;
    void *library = OPEN(given[1]);
    FILE *file = fopen(given[2], "rb");
    if (!library || !file)
        return 3;
    void (*play)(System *, const Equations *) = FIND(library, "core_play_tapes");
    void (*lay)(Work *, int, int, double *) = FIND(library, "core_lay_work");
    int (*solve)(const System *, double, double, double *, double *, const double *, const double *,
                 double, Work *, Info *, int) = FIND(library, "core_integrate");
    if (!play || !lay || !solve)
        return 4;
    static double memory[1 << 13], work_memory[WORK_DOUBLES(1, 1)];
    if (fread(memory, 1, sizeof memory, file) == sizeof memory)
        return 5;
    fclose(file);

    const int32_t *head = (const int32_t *)memory;
    const double *constants = (const double *)(head + HEAD);
    int all = 0;
    for (int k = 0; k < TAPES; k++)
        all += head[6 + 2 * k];
    const char *operations = (const char *)(constants + all);
    Tape tapes[TAPES];
    for (int k = 0; k < TAPES; k++) {
        tapes[k] = (Tape){(const Operation *)operations, constants, head[6 + 2 * k]};
        operations += OPERATION * head[5 + 2 * k];
        constants += head[6 + 2 * k];
    }
    System system = {.states = head[0], .held = head[1], .events = head[2]};
    Work work = {0};
    Info info = {0};
    Equations equations;
    memcpy(&equations, tapes, sizeof equations);
    play(&system, &equations);
    lay(&work, head[0], head[2], work_memory);
    double x = 1.0, u[8] = {0}, p = atof(given[3]), atol = 1e-14;
    const int status =
        solve(&system, 0.0, atof(given[4]), &x, u, &p, &atol, 1e-11, &work, &info, 100000);
    printf("%a %d %d\n", x, status, head[0] == 1 && head[1] <= 8);
    return 0;
}
