/* Two links of our own around an exported law: Lagrange's equations, Runge and Kutta's steps, encoders and a delay.
 *
 * Nothing of slidax is in here but the step that it exports.
 */
#include "slidax_law.h"

#include <math.h>
#include <string.h>

#define LONGEST 8 /* delay, in periods */

typedef struct {
    double masses[2], inertias[2], lengths[2], gravity;
    double q[2];
    double resolution, cutoff; /* a cutoff of 0: velocities are measured */
    double torque, step; /* limits of the drives: of a torque, and of its change in a period */
    long delay, substeps, terms;
} arm_type;

typedef struct {
    double amplitude[2], frequency[2], phase[2];
} term_type;

static void accelerate(const arm_type *arm, const term_type *terms, double t, const double *x, const double *tau,
                       double *out)
{
    const double m2 = arm->masses[1], l1 = arm->lengths[0], l2 = arm->lengths[1];
    const double both = arm->masses[0] + m2, g = arm->gravity;
    const double c2 = cos(x[1]), s2 = sin(x[1]), couple = m2 * l1 * l2;
    const double m11 = both * l1 * l1 + m2 * l2 * l2 + 2.0 * couple * c2 + arm->inertias[0];
    const double m12 = m2 * l2 * l2 + couple * c2, m22 = m2 * l2 * l2 + arm->inertias[1];
    const double fall = m2 * g * l2 * cos(x[0] + x[1]);
    double f[2], det;
    long k;
    int i;
    f[0] = tau[0] + couple * s2 * (2.0 * x[2] * x[3] + x[3] * x[3]) - both * g * l1 * cos(x[0]) - fall;
    f[1] = tau[1] - couple * s2 * x[2] * x[2] - fall;
    for (k = 0; k < arm->terms; ++k) {
        for (i = 0; i < 2; ++i) {
            f[i] += terms[k].amplitude[i] * sin(terms[k].frequency[i] * t + terms[k].phase[i]);
        }
    }
    det = m11 * m22 - m12 * m12;
    out[0] = x[2];
    out[1] = x[3];
    out[2] = (m22 * f[0] - m12 * f[1]) / det;
    out[3] = (m11 * f[1] - m12 * f[0]) / det;
}

static void advance(const arm_type *arm, const term_type *terms, double t, double h, double *x, const double *tau)
{
    double k1[4], k2[4], k3[4], k4[4], y[4];
    int i;
    accelerate(arm, terms, t, x, tau, k1);
    for (i = 0; i < 4; ++i) { y[i] = x[i] + 0.5 * h * k1[i]; }
    accelerate(arm, terms, t + 0.5 * h, y, tau, k2);
    for (i = 0; i < 4; ++i) { y[i] = x[i] + 0.5 * h * k2[i]; }
    accelerate(arm, terms, t + 0.5 * h, y, tau, k3);
    for (i = 0; i < 4; ++i) { y[i] = x[i] + h * k3[i]; }
    accelerate(arm, terms, t + h, y, tau, k4);
    for (i = 0; i < 4; ++i) { x[i] += h * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0; }
}

/* Errors at all samples of one case, [samples][2]. */
void attack(long samples, double period, const double *reference, const arm_type *arm, const term_type *terms,
            double *error)
{
    slidax_law_parameters parameters;
    slidax_law_state state;
    slidax_law_measurement seen;
    slidax_law_reference wanted;
    slidax_law_command command;
    double past[LONGEST + 1][4], x[4], counted[2], filtered[2], tau[2] = {0.0, 0.0};
    long k, j;
    int i;
    slidax_law_parameters_default(&parameters);
    slidax_law_reset(&state);
    (void)memset(&wanted, 0, sizeof wanted);
    for (i = 0; i < 2; ++i) {
        x[i] = arm->q[i];
        x[2 + i] = 0.0;
        counted[i] = x[i];
        filtered[i] = 0.0;
    }
    /* At first the drives hold the arm against its weight. */
    tau[1] = arm->masses[1] * arm->gravity * arm->lengths[1] * cos(x[0] + x[1]);
    tau[0] = tau[1] + (arm->masses[0] + arm->masses[1]) * arm->gravity * arm->lengths[0] * cos(x[0]);
    for (j = 0; j <= LONGEST; ++j) { (void)memcpy(past[j], x, sizeof x); }
    for (k = 0; k < samples; ++k) {
        const double *now = reference + 6 * k, *next = now + 6;
        (void)memcpy(past[k % (LONGEST + 1)], x, sizeof x);
        seen.t = (double)k * period;
        for (i = 0; i < 2; ++i) {
            const double *old = past[(k - arm->delay + 9 * (LONGEST + 1)) % (LONGEST + 1)];
            const double q = arm->resolution > 0.0 ? arm->resolution * rint(old[i] / arm->resolution) : old[i];
            if (k > 0) { filtered[i] -= expm1(-arm->cutoff * period) * ((q - counted[i]) / period - filtered[i]); }
            counted[i] = q;
            seen.q[i] = q;
            seen.dq[i] = arm->cutoff > 0.0 ? filtered[i] : old[2 + i];
            error[2 * k + i] = x[i] - now[i];
            wanted.q[i] = now[i];
            wanted.dq[i] = now[2 + i];
            wanted.ddq[i] = now[4 + i];
            wanted.q_next[i] = next[i];
            wanted.dq_next[i] = next[2 + i];
            wanted.ddq_next[i] = next[4 + i];
        }
        (void)slidax_law_step(&seen, &wanted, &state, &parameters, &command);
        for (i = 0; i < 2; ++i) {
            const double moved = fmax(fmin(command.tau[i] - tau[i], arm->step), -arm->step);
            tau[i] = fmax(fmin(tau[i] + moved, arm->torque), -arm->torque);
        }
        for (j = 0; j < arm->substeps; ++j) {
            const double h = period / (double)arm->substeps;
            advance(arm, terms, seen.t + (double)j * h, h, x, tau);
        }
    }
}
