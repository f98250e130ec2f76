/* Faults of sensors, clock and planner in closed loop with the scenario's own arm.
 *
 * Usage: campaign TIMES SEED DEADLINE
 *
 * One undisturbed run is kept as snapshots. From each random time a branch runs with one fault. A branch is good if the
 * host is asked to stop within 10 samples of the first bad one, or if the joints are inside their envelopes again by the
 * deadline after the last bad sample and stay there for half a second. Prints a line for each kind of fault.
 */
#include "slidax_law.h"
#include "slidax_law_scenario.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef REAL
#define REAL double
#endif
#define N SLIDAX_LAW_JOINTS

typedef struct {
    slidax_law_state state;
    slidax_law_plant plant;
    slidax_law_command command;
} loop;

enum { Q, DQ, CLOCK, REFERENCE_Q, REFERENCE_DQ, KINDS_OF_OUTLIERS };
enum { CONSTANT, RANDOM };
static const char *const names[] = {
    "q once", "dq once", "t once", "reference q once", "reference dq once",
    "q repeated", "dq repeated", "t repeated", "reference q repeated", "reference dq repeated",
    "q random", "dq random", "t random", "reference q random", "reference dq random",
    "lost samples", "NaN samples", "frozen sensors", "swapped joints", "infinite samples",
};
#define KINDS 20

static slidax_law_parameters parameters;

static uint64_t drawn = 1;
static double uniform(void)
{
    drawn ^= drawn << 13;
    drawn ^= drawn >> 7;
    drawn ^= drawn << 17;
    return (double)(drawn >> 11) / 9007199254740992.0;
}
static double outlier(void)
{
    const double size = pow(10.0, -1.0 + 7.0 * uniform());
    return uniform() < 0.5 ? -size : size;
}
static int below(int count) { return (int)(uniform() * count) % count; }

static double error(const loop *l)
{
    slidax_law_reference reference;
    double largest = 0.0;
    slidax_law_motion(l->plant.then[0].t, (REAL)SLIDAX_LAW_PERIOD, &reference);
    for (int j = 0; j < N; ++j) {
        const double e = fabs((double)l->plant.then[0].q[j] - (double)reference.q[j]);
        if (!(e <= largest)) {
            largest = e;
        }
    }
    return largest;
}

static void disturb(int outliers, double size, int joint, slidax_law_measurement *m, slidax_law_reference *r)
{
    switch (outliers) {
    case Q: m->q[joint] += (REAL)size; break;
    case DQ: m->dq[joint] += (REAL)size; break;
    case CLOCK: m->t += (REAL)size; break;
    case REFERENCE_Q: r->q[joint] += (REAL)size; r->q_next[joint] += (REAL)size; break;
    default: r->dq[joint] += (REAL)size; r->dq_next[joint] += (REAL)size; break;
    }
}

int main(int count, char **arguments)
{
    const int times = count > 1 ? atoi(arguments[1]) : 20;
    const double deadline = count > 3 ? atof(arguments[3]) : 2.0;
    const long settle = (long)(0.2 * deadline / (double)SLIDAX_LAW_PERIOD);
    const long span = (long)(1.2 * deadline / (double)SLIDAX_LAW_PERIOD);
    const long steady = (long)(0.5 / (double)SLIDAX_LAW_PERIOD);
    long faults_of_all = 0;
    static loop base, branch;
    long *at = malloc(sizeof *at * (size_t)times);
    int bad_runs = 0;
    drawn += (uint64_t)(count > 2 ? atoi(arguments[2]) : 1) * 7919u;
    for (int k = 0; k < 20; ++k) {
        (void)uniform();
    }
    slidax_law_parameters_default(&parameters);
    for (int kind = 0; kind < KINDS; ++kind) {
        int told = 0, runaways = 0, held = 0, left = 0;
        double slowest = 0.0, farthest = 0.0, torque = 0.0;
        for (int i = 0; i < times; ++i) {
            at[i] = settle + (long)(uniform() * (double)span);
        }
        for (int i = 1; i < times; ++i) {
            for (int j = i; j > 0 && at[j - 1] > at[j]; --j) {
                const long later = at[j - 1];
                at[j - 1] = at[j];
                at[j] = later;
            }
        }
        slidax_law_reset(&base.state);
        slidax_law_start(&base.plant);
        memset(&base.command, 0, sizeof base.command);
        long k = 0;
        for (int i = 0; i < times; ++i) {
            for (; k < at[i]; ++k) {
                slidax_law_measurement m;
                slidax_law_reference r;
                slidax_law_measure(&base.plant, &m);
                slidax_law_motion(m.t, (REAL)SLIDAX_LAW_PERIOD, &r);
                (void)slidax_law_step(&m, &r, &base.state, &parameters, &base.command);
                slidax_law_move(&base.plant, (REAL)SLIDAX_LAW_PERIOD, base.command.tau);
            }
            branch = base;
            const int joint = below(N), other = (joint + 1 + below(N > 1 ? N - 1 : 1)) % N;
            const int length = kind < 5 || kind == 18 ? 1 : 2 + below(kind == 17 ? 49 : 29);
            const double constant = outlier();
            slidax_law_measurement frozen;
            slidax_law_measure(&branch.plant, &frozen);
            const long last = length - 1, end = last + (long)(deadline / (double)SLIDAX_LAW_PERIOD) + steady;
            long inside_since = -1;
            int is_told = 0, is_held = 0, is_left = 0;
            double largest = 0.0;
            for (long n = 0; n <= end; ++n) {
                slidax_law_measurement m;
                slidax_law_reference r;
                unsigned status = 0;
                int called = 1;
                slidax_law_measure(&branch.plant, &m);
                slidax_law_motion(m.t, (REAL)SLIDAX_LAW_PERIOD, &r);
                if (n <= last) {
                    if (kind < 15) {
                        disturb(kind % 5, kind / 5 == 2 ? outlier() : constant, joint, &m, &r);
                    } else if (kind == 15) {
                        called = 0;
                    } else if (kind == 16) {
                        m.q[joint] = (REAL)NAN;
                    } else if (kind == 17) {
                        memcpy(m.q, frozen.q, sizeof m.q);
                        memcpy(m.dq, frozen.dq, sizeof m.dq);
                    } else if (kind == 18) {
                        const REAL q = m.q[joint], dq = m.dq[joint];
                        m.q[joint] = m.q[other];
                        m.dq[joint] = m.dq[other];
                        m.q[other] = q;
                        m.dq[other] = dq;
                    } else {
                        m.dq[joint] = (REAL)INFINITY;
                    }
                }
                if (called) {
                    status = slidax_law_step(&m, &r, &branch.state, &parameters, &branch.command);
                }
                for (int j = 0; j < N; ++j) {
                    const double size = fabs((double)branch.command.tau[j]) / (double)parameters.limits_torque[j];
                    if (!(size <= torque)) {
                        torque = size;
                    }
                }
                slidax_law_move(&branch.plant, (REAL)SLIDAX_LAW_PERIOD, branch.command.tau);
                const double e = error(&branch);
                if (!(e <= largest)) {
                    largest = e;
                }
                if ((status & SLIDAX_LAW_STOP_REQUESTED) != 0u && n <= 10) {
                    is_told = 1;
                    break;
                }
                is_held |= (status & SLIDAX_LAW_HELD) != 0u;
                if (n > last) {
                    is_left |= (status & SLIDAX_LAW_ENVELOPE_LEFT) != 0u;
                    /* A step that holds its command does not know where the arm is. */
                    if ((status & (SLIDAX_LAW_ENVELOPE_LEFT | SLIDAX_LAW_HELD)) != 0u) {
                        inside_since = -1;
                    } else if (inside_since < 0) {
                        inside_since = n;
                    }
                    if (inside_since >= 0 && n - inside_since > steady) {
                        break;
                    }
                }
            }
            const double back = inside_since < 0 ? INFINITY : (double)(inside_since - last) * (double)SLIDAX_LAW_PERIOD;
            if (is_told) {
                ++told;
            } else if (!(back <= deadline)) {
                ++runaways;
                fprintf(stderr, "%s: at %ld, %d samples, joint %d, size %g: error at most %g\n", names[kind], at[i],
                        length, joint, constant, largest);
            } else {
                slowest = fmax(slowest, back);
                farthest = fmax(farthest, largest);
            }
            held += is_held;
            left += is_left;
        }
        printf("%-22s runs %d told %d held %d left %d runaways %d slowest_back_s %.4g largest_error %.3g torque %.17g\n",
               names[kind], times, told, held, left, runaways, slowest, farthest, torque);
        bad_runs += runaways + !(torque <= 1.0);
        faults_of_all += times;
    }
    printf("all: %ld runs, %d bad\n", faults_of_all, bad_runs);
    free(at);
    return bad_runs != 0;
}
