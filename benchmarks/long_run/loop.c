/* The exported step in its closed loop, for as many steps as one likes, without a reset.
 *
 * Usage: loop STEPS SHOWN RESOLUTION
 *
 * After each SHOWN steps, and at the end: how many torques were not finite, all status bits seen, the largest error, and
 * the largest size of each number that the law keeps, of all steps since the line before. RESOLUTION is that of the
 * encoders, 0 for exact ones. `kept.h` is made beside it: NUMBERS(NAME, COUNT) for each member of the memory that holds
 * real numbers.
 */
#include "slidax_law.h"
#include "slidax_law_scenario.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Where a counter of instructions begins and ends to count: see count.c. */
__attribute__((noinline)) void step_begins(void)
{
    __asm__ volatile("");
}

__attribute__((noinline)) void step_ends(void)
{
    __asm__ volatile("");
}

#define NUMBERS(name, count) {#name, offsetof(slidax_law_memory, name) / sizeof(double), count},
typedef struct {
    const char *name;
    size_t first;
    size_t count;
} kept;

static const kept members[] = {
#include "kept.h"
};
#define MEMBERS (sizeof members / sizeof members[0])

static double sizes[MEMBERS];
static double error;
static unsigned long not_finite;
static slidax_law_status seen;

static void larger(double *most, double number)
{
    /* What is no number is larger than all, and stays. */
    if (!isnan(*most) && !(fabs(number) <= *most)) {
        *most = fabs(number);
    }
}

static void show(long steps)
{
    size_t k;
    printf("%ld %lu %lu %.17g", steps, not_finite, (unsigned long)seen, error);
    for (k = 0; k < MEMBERS; ++k) {
        printf(" %s=%.17g", members[k].name, sizes[k]);
    }
    printf("\n");
    (void)fflush(stdout);
    memset(sizes, 0, sizeof sizes);
    error = 0.0;
    not_finite = 0;
    seen = SLIDAX_LAW_OK;
}

static void note(const slidax_law_plant *plant, const slidax_law_reference *reference, const slidax_law_state *state,
                 const slidax_law_command *command)
{
    double numbers[sizeof(slidax_law_memory) / sizeof(double)];
    size_t k;
    size_t j;
    memcpy(numbers, &state->memory, sizeof numbers);
    for (k = 0; k < MEMBERS; ++k) {
        for (j = 0; j < members[k].count; ++j) {
            larger(&sizes[k], numbers[members[k].first + j]);
        }
    }
    for (j = 0; j < SLIDAX_LAW_JOINTS; ++j) {
        not_finite += !isfinite(command->tau[j]);
        if (plant->then[0].t > SLIDAX_LAW_T1) {
            larger(&error, plant->then[0].q[j] - reference->q[j]);
        }
    }
}

int main(int count, char **arguments)
{
    const long steps = count > 1 ? strtol(arguments[1], NULL, 10) : 1000000;
    const long shown = count > 2 ? strtol(arguments[2], NULL, 10) : steps;
    const double resolution = count > 3 ? strtod(arguments[3], NULL) : 0.0;
    slidax_law_parameters parameters;
    slidax_law_plant plant;
    slidax_law_state state;
    slidax_law_measurement measurement;
    slidax_law_reference reference;
    slidax_law_reference now;
    slidax_law_command command;
    long k;
    slidax_law_parameters_default(&parameters);
    slidax_law_reset(&state);
    slidax_law_start(&plant);
    for (k = 1; k <= steps; ++k) {
        int j;
        slidax_law_motion(plant.then[0].t, parameters.period, &now);
        slidax_law_measure(&plant, &measurement);
        slidax_law_motion(measurement.t, parameters.period, &reference);
        for (j = 0; j < SLIDAX_LAW_JOINTS && resolution > 0.0; ++j) {
            measurement.q[j] = resolution * nearbyint(measurement.q[j] / resolution);
        }
        /* The first step also computes what follows from the parameters alone. */
        if (k > 1) {
            step_begins();
        }
        seen |= slidax_law_step(&measurement, &reference, &state, &parameters, &command);
        if (k > 1) {
            step_ends();
        }
        note(&plant, &now, &state, &command);
        slidax_law_move(&plant, parameters.period, command.tau);
        if (k % shown == 0 || k == steps) {
            show(k);
        }
    }
    return 0;
}
