/* Many runs of an exported law on members of its set, with an integrator and encoders of its own; see campaign.py.
   Compiled for each law: the folder of `slidax export c --name law` is on the include path. */
#include <stdint.h>
#include "attack.c"
#include "slidax_law.h"
#include "slidax_law.c"
#define J SLIDAX_LAW_JOINTS
#define DELAYS 16

typedef struct {
    int member, pattern;     /* pattern of the signs of the disturbance; -1: friction against the velocity alone */
    double coulomb[J];       /* N m: friction against the velocity; with a pattern, the size of its torque instead */
    double push[J];          /* N m: further size of the pattern's torque */
    double phase[J];         /* of the encoder's grid, in steps */
    double start[2][J];      /* error of position and velocity at the start */
} choice_t;

/* error, velocity, torque, torque step, estimate */
enum { ERROR, VELOCITY, TORQUE, STEP, ESTIMATE, KINDS };

typedef struct {
    double worst[KINDS];  /* largest ratio to the bound */
    double alarm, left;   /* first time that the law's monitor warns, and that the error passes `allowed`; -1: never */
    uint32_t status;      /* all bits of the steps */
    int rejected;
} outcome_t;

/* desired: [(slots + 1) * sub + 1][2][J] at substeps. patterns: [.][slots * sub][J], signs.
   bounds: [slots][KINDS][J]. held: [J], torque before the first command. allowed: [J]. */
void campaign(const arm_t *members, int runs, const choice_t *choices, double h, int delay, int slots, int sub,
              const double *desired, const int8_t *patterns, const double *resolution, const double *bounds,
              const double *held, const double *allowed, outcome_t *outcomes) {
    slidax_law_parameters parameters;
    static slidax_law_state state;
    slidax_law_parameters_default(&parameters);
    for (int run = 0; run < runs; run++) {
        const choice_t *c = choices + run;
        const arm_t *arm = members + c->member;
        outcome_t *out = outcomes + run;
        double q[J], v[J], ring[DELAYS][J], last[J], dt = h / sub;
        memset(out, 0, sizeof *out);
        out->alarm = out->left = -1;
        for (int i = 0; i < J; i++) {
            q[i] = desired[i] + c->start[0][i]; v[i] = desired[J + i] + c->start[1][i]; last[i] = held[i];
            for (int k = 0; k < DELAYS; k++) ring[k][i] = q[i];
        }
        slidax_law_reset(&state);
        for (int k = 0; k < slots; k++) {
            const double *now = desired + (size_t)k * sub * 2 * J, *next = now + (size_t)sub * 2 * J;
            const double *bound = bounds + (size_t)k * KINDS * J;
            slidax_law_measurement measured = {0};
            slidax_law_reference reference = {0};
            slidax_law_command command;
            memcpy(ring[k % DELAYS], q, sizeof q);
            measured.t = k * h;
            for (int i = 0; i < J; i++) {
                double old = ring[(k + DELAYS - delay) % DELAYS][i], r = resolution[i];
                measured.q[i] = r > 0 ? r * (floor(old / r + c->phase[i]) - c->phase[i] + 0.5) : old;
                reference.q[i] = now[i]; reference.dq[i] = now[J + i];
                reference.q_next[i] = next[i]; reference.dq_next[i] = next[J + i];
            }
            uint32_t status = slidax_law_step(&measured, &reference, &state, &parameters, &command);
            out->status |= status;
            if ((status & SLIDAX_LAW_PROMISE_VOID) && out->alarm < 0) out->alarm = k * h;
            out->rejected += command.rejected > 0;
            for (int i = 0; i < J; i++) {
                out->worst[TORQUE] = fmax(out->worst[TORQUE], fabs(command.tau[i]) / bound[TORQUE * J + i]);
                out->worst[STEP] = fmax(out->worst[STEP], fabs(command.tau[i] - last[i]) / bound[STEP * J + i]);
                out->worst[ESTIMATE] =
                    fmax(out->worst[ESTIMATE], fabs(command.disturbance[i]) / bound[ESTIMATE * J + i]);
                last[i] = command.tau[i];
            }
            for (int s = 0; s < sub; s++) {
                const double *ref = now + (size_t)s * 2 * J;
                const int8_t *sign = c->pattern < 0 ? 0 : patterns + (((size_t)c->pattern * slots + k) * sub + s) * J;
                double total[J], a[J], q2[J], v2[J];
                for (int i = 0; i < J; i++) {
                    double e = fabs(q[i] - ref[i]);
                    out->worst[ERROR] = fmax(out->worst[ERROR], e / bound[ERROR * J + i]);
                    out->worst[VELOCITY] = fmax(out->worst[VELOCITY], fabs(v[i] - ref[J + i]) / bound[VELOCITY * J + i]);
                    if (e > allowed[i] && out->left < 0) out->left = k * h + s * dt;
                }
#define TOTAL(V) for (int i = 0; i < J; i++) \
    total[i] = command.tau[i] - arm->viscous[i] * V[i] + (sign ? sign[i] * (c->coulomb[i] + c->push[i]) : \
        -c->coulomb[i] * ((V[i] > 0) - (V[i] < 0)));
                TOTAL(v) accelerate(arm, q, v, total, a);
                for (int i = 0; i < J; i++) { q2[i] = q[i] + .5 * dt * v[i]; v2[i] = v[i] + .5 * dt * a[i]; }
                TOTAL(v2) accelerate(arm, q2, v2, total, a);
                for (int i = 0; i < J; i++) { q[i] += dt * v2[i]; v[i] += dt * a[i]; }
            }
        }
    }
}
