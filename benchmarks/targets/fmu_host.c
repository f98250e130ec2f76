/* Loads the binary of an FMU, feeds it samples from standard input, and prints the torques of each.
 *
 * Input: token, period, number of samples, of inputs and of outputs; their value references; a row for each sample.
 */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#ifdef _WIN32
#include <windows.h>
static void *opened(const char *file) { return (void *)LoadLibraryA(file); }
static void *function(void *library, const char *name) { return (void *)GetProcAddress((HMODULE)library, name); }
#else
#include <dlfcn.h>
static void *opened(const char *file) { return dlopen(file, RTLD_NOW); }
static void *function(void *library, const char *name) { return dlsym(library, name); }
#endif

typedef void *(*instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t,
                             void *, void *, void *);
typedef int (*enter)(void *, bool, double, double, bool, double);
typedef int (*leave)(void *);
typedef int (*set)(void *, const uint32_t *, size_t, const double *, size_t);
typedef int (*get)(void *, const uint32_t *, size_t, double *, size_t);
typedef int (*step)(void *, double, double, bool, bool *, bool *, bool *, double *);

static void say(void *environment, int status, const char *category, const char *message)
{
    (void)environment;
    fprintf(stderr, "%d %s: %s\n", status, category, message);
}

int main(int count, char **arguments)
{
    static uint32_t references[1000];
    static double values[1000];
    char token[80];
    double period;
    long samples, k;
    size_t given, wanted, i;
    void *const library = count > 1 ? opened(arguments[1]) : NULL;
    void *self;
    bool flags[3];
    double reached;
    if (library == NULL || scanf("%79s %lf %ld %zu %zu", token, &period, &samples, &given, &wanted) != 5
        || given + wanted > 1000) {
        return 1;
    }
    for (i = 0; i < given + wanted; ++i) {
        if (scanf("%u", &references[i]) != 1) {
            return 1;
        }
    }
    self = ((instantiate)function(library, "fmi3InstantiateCoSimulation"))(
        "law", token, NULL, false, true, false, false, NULL, 0, NULL, (void *)say, NULL);
    if (self == NULL || ((enter)function(library, "fmi3EnterInitializationMode"))(self, false, 0, 0, false, 0) != 0
        || ((leave)function(library, "fmi3ExitInitializationMode"))(self) != 0) {
        return 2;
    }
    for (k = 0; k < samples; ++k) {
        for (i = 0; i < given; ++i) {
            if (scanf("%lf", &values[i]) != 1) {
                return 1;
            }
        }
        if (((set)function(library, "fmi3SetFloat64"))(self, references, given, values, given) != 0
            || ((step)function(library, "fmi3DoStep"))(
                   self, (double)k * period, period, true, &flags[0], &flags[1], &flags[2], &reached) != 0
            || ((get)function(library, "fmi3GetFloat64"))(self, references + given, wanted, values, wanted) != 0) {
            return 3;
        }
        for (i = 0; i < wanted; ++i) {
            printf("%.17g ", values[i]);
        }
        printf("\n");
    }
    ((void (*)(void *))function(library, "fmi3FreeInstance"))(self);
    return 0;
}
