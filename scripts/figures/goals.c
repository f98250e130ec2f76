/* A goal in MuJoCo under an exported law; called by goals.py, compiled with the law and its admission. */
#include <math.h>
#include <string.h>

#include <mujoco/mujoco.h>

#include "slidax_law_admission.h"
#include "slidax_law_flat.h"

#define J SLIDAX_LAW_ADMISSION_JOINTS
#define DELAYS 16

/* Positions, velocities and accelerations of a motion at a time, one after the other. */
static void reference_at(const slidax_law_planned_motion *motion, double t, double *reference)
{
    int piece = 0;
    while (piece < motion->pieces - 1 && t >= motion->times[piece + 1])
        piece++;
    const double start = motion->times[0], end = motion->times[motion->pieces];
    const double s = fmin(fmax(t, start), end) - motion->times[piece];
    for (int k = 0; k < J; k++) {
        double q = 0.0, dq = 0.0, half = 0.0;
        for (int p = 0; p < motion->powers; p++) {
            half = half * s + dq;
            dq = dq * s + q;
            q = q * s + motion->coefficients[piece][k][p];
        }
        const int moves = t >= start && t < end;
        reference[k] = q;
        reference[J + k] = moves ? dq : 0.0;
        reference[2 * J + k] = moves ? 2.0 * half : 0.0;
    }
}

/* Run a motion and `rest` seconds after it; `worst` gets each joint's largest error. Returns all bits of the status. */
uint32_t follow(const mjModel *model, mjData *data, slidax_law_flat *law, const slidax_law_planned_motion *motion,
                double period, int substeps, int delay, double rest, double resolution, double *worst)
{
    double ring[DELAYS][J], now[3 * J], next[3 * J], tau[J], nothing[J] = {0};
    uint32_t bits = 0;
    mj_resetData(model, data);
    reference_at(motion, 0.0, now);
    memcpy(data->qpos, now, sizeof ring[0]);
    for (int i = 0; i < DELAYS; i++)
        memcpy(ring[i], now, sizeof ring[i]);
    memset(worst, 0, sizeof ring[0]);
    slidax_law_flat_reset(law);
    const int count = (int)((motion->times[motion->pieces] + rest) / period);
    for (int k = 0; k < count; k++) {
        memcpy(ring[k % DELAYS], data->qpos, sizeof ring[0]);
        double measured[J];
        for (int i = 0; i < J; i++)
            measured[i] = resolution * rint(ring[(k + DELAYS - delay) % DELAYS][i] / resolution);
        reference_at(motion, k * period, now);
        reference_at(motion, (k + 1) * period, next);
        bits |= slidax_law_flat_step(law, k * period, measured, nothing, now, next, tau);
        memcpy(data->qfrc_applied, tau, sizeof tau);
        for (int s = 0; s < substeps; s++) {
            reference_at(motion, (k + (double)s / substeps) * period, now);
            for (int i = 0; i < J; i++)
                worst[i] = fmax(worst[i], fabs(data->qpos[i] - now[i]));
            mj_step(model, data);
        }
    }
    return bits;
}
