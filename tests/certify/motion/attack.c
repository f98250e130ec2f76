/* An arm under the certified law, written without any of slidax: Newton-Euler in link frames, Gauss elimination,
   quantised encoders, a delay in periods, and a torque that is held. See plant.py. */
#include <math.h>
#include <string.h>
#define N 8

typedef struct {
    int n;
    int revolute[N];
    double rot[N][9], pos[N][3];           /* frame in the parent's, at position 0; row-major */
    double mass[N], com[N][3], inertia[N][9]; /* about the centre of mass, in the link's axes */
    double rotor[N], viscous[N], gravity[3];
} arm_t;

static void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1]; c[1] = a[2] * b[0] - a[0] * b[2]; c[2] = a[0] * b[1] - a[1] * b[0];
}
static void mul(const double *m, const double *x, double *y) {
    for (int i = 0; i < 3; i++) y[i] = m[3*i] * x[0] + m[3*i+1] * x[1] + m[3*i+2] * x[2];
}
static void mult(const double *m, const double *x, double *y) {
    for (int i = 0; i < 3; i++) y[i] = m[i] * x[0] + m[3+i] * x[1] + m[6+i] * x[2];
}

/* Inverse dynamics without friction; g scales gravity. A chain: the parent of i is i - 1. */
void torques(const arm_t *arm, const double *q, const double *v, const double *a, double g, double *tau) {
    double R[N][9], P[N][3], f[N][3], t[N][3];
    double w[3] = {0}, dw[3] = {0}, acc[3];
    for (int i = 0; i < 3; i++) acc[i] = -g * arm->gravity[i];
    for (int i = 0; i < arm->n; i++) {
        double c = 1, s = 0, slide = 0;
        if (arm->revolute[i]) { c = cos(q[i]); s = sin(q[i]); } else slide = q[i];
        for (int r = 0; r < 3; r++) {
            const double *o = arm->rot[i] + 3 * r;
            R[i][3*r] = c * o[0] + s * o[1]; R[i][3*r+1] = c * o[1] - s * o[0]; R[i][3*r+2] = o[2];
            P[i][r] = arm->pos[i][r] + slide * o[2];
        }
        double x[3], y[3], at[3], wi[3], dwi[3], ai[3];
        cross(dw, P[i], x); cross(w, P[i], y); double z[3]; cross(w, y, z);
        for (int r = 0; r < 3; r++) at[r] = acc[r] + x[r] + z[r];
        mult(R[i], w, wi); mult(R[i], dw, dwi); mult(R[i], at, ai);
        if (arm->revolute[i]) {
            dwi[0] += wi[1] * v[i]; dwi[1] -= wi[0] * v[i]; dwi[2] += a[i];
            wi[2] += v[i];
        } else {
            ai[0] += 2 * wi[1] * v[i]; ai[1] -= 2 * wi[0] * v[i]; ai[2] += a[i];
        }
        double ac[3], Iw[3], Id[3];
        cross(dwi, arm->com[i], x); cross(wi, arm->com[i], y); cross(wi, y, z);
        for (int r = 0; r < 3; r++) { ac[r] = ai[r] + x[r] + z[r]; f[i][r] = arm->mass[i] * ac[r]; }
        mul(arm->inertia[i], wi, Iw); mul(arm->inertia[i], dwi, Id); cross(wi, Iw, x); cross(arm->com[i], f[i], y);
        for (int r = 0; r < 3; r++) t[i][r] = Id[r] + x[r] + y[r];
        memcpy(w, wi, sizeof w); memcpy(dw, dwi, sizeof dw); memcpy(acc, ai, sizeof acc);
    }
    for (int i = arm->n - 1; i >= 0; i--) {
        tau[i] = (arm->revolute[i] ? t[i][2] : f[i][2]) + arm->rotor[i] * a[i];
        if (i) {
            double F[3], T[3], x[3];
            mul(R[i], f[i], F); mul(R[i], t[i], T); cross(P[i], F, x);
            for (int r = 0; r < 3; r++) { f[i-1][r] += F[r]; t[i-1][r] += T[r] + x[r]; }
        }
    }
}

void inertia_of(const arm_t *arm, const double *q, double *M) {
    double zero[N] = {0}, a[N], tau[N];
    for (int j = 0; j < arm->n; j++) {
        memset(a, 0, sizeof a); a[j] = 1;
        torques(arm, q, zero, a, 0, tau);
        for (int i = 0; i < arm->n; i++) M[i * arm->n + j] = tau[i];
    }
}

void solve(int n, double *M, double *b) {
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++) {
            double f = M[i*n+k] / M[k*n+k];
            for (int j = k; j < n; j++) M[i*n+j] -= f * M[k*n+j];
            b[i] -= f * b[k];
        }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) b[i] -= M[i*n+j] * b[j];
        b[i] /= M[i*n+i];
    }
}

static void accelerate(const arm_t *arm, const double *q, const double *v, const double *tau, double *a) {
    double M[N*N], zero[N] = {0}, bias[N];
    inertia_of(arm, q, M);
    torques(arm, q, v, zero, 1, bias);
    for (int i = 0; i < arm->n; i++) a[i] = tau[i] - bias[i];
    solve(arm->n, M, a);
}

/* A plan with an envelope and the paper's surface, per joint. now, ahead: N and A in each slot [slots + delay][n]. */
typedef struct {
    double horizon, lower[N], upper[N], k1[N], k2[N], p[N], q[N], delta[N];
    const double *now, *ahead;
} plan_t;

static double bent(double x, double p, double d) {
    double a = fabs(x), l1 = pow(d, p - 1) * (p*p/2 - 5*p/2 + 3), l2 = pow(d, p - 2) * (-p*p + 4*p - 3),
           l3 = pow(d, p - 3) * (p*p/2 - 3*p/2 + 1);
    double y = a >= d ? pow(a, p) : a * (l1 + a * (l2 + a * l3));
    return x < 0 ? -y : y;
}

/* A psi(eps)/H^2 with N psi(eps) + H phi(eps) = y, by bisection; phi grows without end. */
static double goal(const plan_t *plan, int slot, int n, int i, double y) {
    double b = plan->lower[i], t = plan->upper[i], low = -300, high = 300, place = 0;
    for (int k = 0; k < 120; k++) {
        double x = 0.5 * (low + high), z = exp(x);
        place = b * t * (z - 1) / (b * z - t);
        double a = fabs(x), far = (x < 0 ? -1 : 1) * pow(a, plan->q[i]);
        double phi = plan->k1[i] * bent(x, plan->p[i], plan->delta[i]) + plan->k2[i] * far;
        if (plan->now[slot*n+i] * place + plan->horizon * phi < y) low = x; else high = x;
    }
    return plan->ahead[slot*n+i] * place / (plan->horizon * plan->horizon);
}

/* friction: 0: Coulomb by the sign of the velocity, else the pattern `push` alone, which holds for each substep.
   desired: [(slots + 1) * sub + 1][2][n], position and velocity at substeps. push: [slots * sub][n], N m.
   start: position and velocity [2][n]. phase: of the encoder's grid [n].
   largest: [slots][2][n] of |q - q_d| and |v - dq_d| over the substeps of each slot. trace, unless null:
   plan: null for computed torque. [slots][sub][6][n]: q, v, a; [.][3] command acceleration u - w^ ; [4] qm; [5] vm. torque: [slots][n]. */
void run(const arm_t *truth, const arm_t *model, double h, double kp, double kd, const double *gains, int delay, int slots, int sub,
         const double *desired, const double *push, int friction, const double *coulomb, double resolution,
         const double *phase, const double *start, int settled, const plan_t *plan, double *largest, double *trace, double *torque) {
    int n = truth->n;
    double q[N], v[N], qh[N], vh[N], wh[N], held[N];
    double ring_tau[16][N], ring_a[16][N], ring_w[16][N], ring_q[16][N], ring_v[16][N];
    double zero[N] = {0}, dt = h / sub;
    for (int i = 0; i < n; i++) {
        q[i] = start[i]; v[i] = start[n+i]; qh[i] = q[i]; vh[i] = desired[n+i]; wh[i] = 0;
    }
    if (settled) {
        double M[N*N], b0[N], b1[N];
        torques(model, q, zero, zero, 1, b0); torques(truth, q, zero, zero, 1, b1);
        for (int i = 0; i < n; i++) wh[i] = b0[i] - b1[i];
        inertia_of(model, q, M); solve(n, M, wh);
    }
    torques(model, q, zero, zero, 1, held);
    if (settled) torques(truth, q, zero, zero, 1, held);
    for (int k = 0; k < delay; k++)
        for (int i = 0; i < n; i++) {
            ring_tau[k][i] = held[i]; ring_a[k][i] = -wh[i]; ring_w[k][i] = wh[i];
            ring_q[k][i] = qh[i]; ring_v[k][i] = vh[i];
        }
    for (int k = 0; k < slots; k++) {
        int D = delay + 1;
        double at[N], rate[N];
        for (int i = 0; i < n; i++) {
            double y = resolution > 0 ? resolution * (floor(q[i] / resolution + phase[i]) - phase[i] + 0.5) : q[i];
            double r = y - qh[i];
            qh[i] += gains[0] * r; vh[i] += gains[1] * r; wh[i] += gains[2] * r;
            at[i] = qh[i]; rate[i] = vh[i];
            for (int j = 0; j < delay; j++) {
                double a = ring_a[(k + j) % D][i] + wh[i];
                at[i] += h * rate[i] + 0.5 * h * h * a; rate[i] += h * a;
                if (j == 0) { qh[i] = at[i]; vh[i] = rate[i]; }
            }
        }
        /* The torque of slot k + delay. */
        const double *now = desired + (size_t)(k + delay) * sub * 2 * n, *next = now + (size_t)sub * 2 * n;
        double u[N], qm[N], vm[N], tau[N];
        for (int i = 0; i < n; i++) {
            double mean = (next[n+i] - now[n+i]) / h, e = at[i] - now[i], de = rate[i] - now[n+i];
            u[i] = mean - kp * e - kd * de;
            if (plan) u[i] += goal(plan, k + delay, n, i, e + (plan->horizon - 0.5 * h) * de);
            qm[i] = at[i] + 0.5 * h * rate[i] + 0.125 * h * h * u[i]; vm[i] = rate[i] + 0.5 * h * u[i];
            if (delay == 0) { qh[i] += h * vh[i] + 0.5 * h * h * u[i]; vh[i] += h * u[i]; }
            u[i] -= wh[i];
        }
        torques(model, qm, vm, u, 1, tau);
        int slot = (k + delay) % D;
        for (int i = 0; i < n; i++) {
            tau[i] += model->viscous[i] * 0.5 * (now[n+i] + next[n+i]);
            ring_tau[slot][i] = tau[i]; ring_a[slot][i] = u[i]; ring_w[slot][i] = wh[i];
            ring_q[slot][i] = qm[i]; ring_v[slot][i] = vm[i];
        }
        const double *applied = ring_tau[k % D];
        if (torque) memcpy(torque + (size_t)k * n, applied, n * sizeof(double));
        double *most = largest + (size_t)k * 2 * n;
        memset(most, 0, 2 * n * sizeof(double));
        for (int s = 0; s <= sub; s++) {
            const double *ref = desired + ((size_t)k * sub + s) * 2 * n;
            for (int i = 0; i < n; i++) {
                most[i] = fmax(most[i], fabs(q[i] - ref[i])); most[n+i] = fmax(most[n+i], fabs(v[i] - ref[n+i]));
            }
            if (s == sub) break;
            const double *p = push + ((size_t)k * sub + s) * n;
            double total[N], a1[N], a2[N], a3[N], a4[N], q2[N], v2[N], q3[N], v3[N], q4[N], v4[N];
#define FORCE(V) for (int i = 0; i < n; i++) \
    total[i] = applied[i] + p[i] - truth->viscous[i] * V[i] - (friction ? 0 : coulomb[i] * ((V[i] > 0) - (V[i] < 0)));
            FORCE(v) accelerate(truth, q, v, total, a1);
            for (int i = 0; i < n; i++) { q2[i] = q[i] + .5*dt*v[i]; v2[i] = v[i] + .5*dt*a1[i]; }
            FORCE(v2) accelerate(truth, q2, v2, total, a2);
            for (int i = 0; i < n; i++) { q3[i] = q[i] + .5*dt*v2[i]; v3[i] = v[i] + .5*dt*a2[i]; }
            FORCE(v3) accelerate(truth, q3, v3, total, a3);
            for (int i = 0; i < n; i++) { q4[i] = q[i] + dt*v3[i]; v4[i] = v[i] + dt*a3[i]; }
            FORCE(v4) accelerate(truth, q4, v4, total, a4);
            if (trace) {
                double *o = trace + (((size_t)k * sub + s) * 6) * n;
                for (int i = 0; i < n; i++) {
                    o[i] = q[i]; o[n+i] = v[i]; o[2*n+i] = a1[i]; o[3*n+i] = ring_a[k % D][i];
                    o[4*n+i] = ring_q[k % D][i]; o[5*n+i] = ring_v[k % D][i];
                }
            }
            for (int i = 0; i < n; i++) {
                q[i] += dt / 6 * (v[i] + 2*v2[i] + 2*v3[i] + v4[i]);
                v[i] += dt / 6 * (a1[i] + 2*a2[i] + 2*a3[i] + a4[i]);
            }
        }
    }
}
