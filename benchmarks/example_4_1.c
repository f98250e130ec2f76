/*
 * Example 4.1 of "Approximate continuous fixed-time terminal sliding mode control with prescribed performance for
 * uncertain robotic manipulators" (Nonlinear Dynamics, 2022, doi 10.1007/s11071-022-07650-w): a two-link arm under the
 * CFTSMPPC law (51), written by hand as a yardstick of speed. All gains, masses and coefficients of trajectory and
 * disturbance are data, in a struct that the compiler cannot look into: they are a program's parameters at run time.
 * Numbers in parentheses are the paper's equations.
 *
 *   gcc -O3 example_4_1.c -o example_4_1 -lm
 *   ./example_4_1 held|continuous [steps] [period] [disturbance_scale] [repeats]
 */
#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { N = 2, BANDS = 5, TERMS = 8 };          /* joints, settling bands, most terms of a sum */
enum { HELD, CONTINUOUS, MODES };
enum { COMPLETED, LEFT_ENVELOPE, NOT_FINITE };

/* ---- parameters ------------------------------------------------------------------------------------------------ */

typedef struct {
    double lengths[2], masses[2], inertias[2], gravity;
} Robot;

typedef struct {
    double amplitude[N], frequency[N], phase[N];
} Harmonic;

typedef struct {
    Robot robot, nominal;
    int exponentials, harmonics;                 /* how many of the two that follow are in use */
    double offset[N], amplitude[TERMS][N], rate[TERMS];
    Harmonic harmonic[TERMS];
    double scale;                                /* of the disturbance */
    double rho_start[N], rho_end[N], rho_time[N], sigma[N], overshoot[N];
    double k1[N], k2[N], p[N], q[N], delta[N];
    double k0[N][N], r, s0;
    double inertia_lo, inertia_hi, margin, bound0, bound1, bound2;
    double q_start[N], dq_start[N], band[BANDS]; /* bands decreasing: tally_error() relies on it */
} Parameters;

/* What follows from the parameters alone, before the loop. */
typedef struct {
    double a, b, c, d, g1, g2; /* M = [a + 2c cos q2, b + c cos q2; ., d], G = [g1 cos q1 + g2 cos(q1 + q2); g2 ...] */
} Arm;

typedef struct {
    Arm robot, nominal;
    double lower[N], upper[N], log_scale[N];     /* sides (13), upper/-lower */
    double inv_time[N], span[N], drho[N], ddrho[N], inv_end[N]; /* factors of (20) and its derivatives */
    double l1[N], l2[N], l3[N];                  /* (30)-(32) */
    double gamma, inv_gamma;                     /* (46), 1/(1 - gamma) */
    bool one_sine[TERMS];                        /* whether the joints of a harmonic share frequency and phase */
} Derived;

static Arm arm_of(const Robot *r)
{
    const double m1 = r->masses[0], m2 = r->masses[1], l1 = r->lengths[0], l2 = r->lengths[1];

    return (Arm){(m1 + m2) * l1 * l1 + m2 * l2 * l2 + r->inertias[0],
                 m2 * l2 * l2,
                 m2 * l1 * l2,
                 m2 * l2 * l2 + r->inertias[1],
                 (m1 + m2) * l1 * r->gravity,
                 m2 * l2 * r->gravity};
}

static Derived derive(const Parameters *x)
{
    Derived y = {.robot = arm_of(&x->robot), .nominal = arm_of(&x->nominal)};

    for (int i = 0; i < N; ++i) {
        const double p = x->p[i], s = x->sigma[i], inv = 1.0 / x->rho_time[i];
        double qd = x->offset[i];

        for (int j = 0; j < x->exponentials; ++j)
            qd += x->amplitude[j][i];
        const bool positive = x->q_start[i] >= qd;

        y.lower[i] = positive ? -x->overshoot[i] : -1.0;
        y.upper[i] = positive ? 1.0 : x->overshoot[i];
        y.log_scale[i] = -y.upper[i] / y.lower[i];
        y.inv_time[i] = inv;
        y.span[i] = x->rho_start[i] - x->rho_end[i];
        y.drho[i] = -s * inv * y.span[i];
        y.ddrho[i] = s * (s - 1.0) * inv * inv * y.span[i];
        y.inv_end[i] = 1.0 / x->rho_end[i];
        y.l1[i] = (0.5 * p * p - 2.5 * p + 3.0) * pow(x->delta[i], p - 1.0);
        y.l2[i] = (-p * p + 4.0 * p - 3.0) * pow(x->delta[i], p - 2.0);
        y.l3[i] = (0.5 * p * p - 1.5 * p + 1.0) * pow(x->delta[i], p - 3.0);
    }
    y.gamma = (x->inertia_hi - x->inertia_lo) / (x->inertia_hi + x->inertia_lo);
    y.inv_gamma = 1.0 / (1.0 - y.gamma);
    for (int j = 0; j < x->harmonics; ++j)
        y.one_sine[j] = x->harmonic[j].frequency[0] == x->harmonic[j].frequency[1]
                        && x->harmonic[j].phase[0] == x->harmonic[j].phase[1];
    return y;
}

/* ---- what depends on time alone -------------------------------------------------------------------------------- */

typedef struct {
    double t;
    double qd[N], dqd[N], ddqd[N];                  /* reference */
    double rho[N], inv_rho[N], alpha[N], dalpha[N]; /* (20), its reciprocal, (26) and the diagonal of A' */
    double disturbance[N];
} Signals;

/* x^y for x >= 0. Faster than pow(), and as |y| < 1 and x is no extreme here the same to an ulp or two. */
static inline double power_of(double x, double y)
{
    return exp(y * log(x));
}

static inline void signals_at(const Parameters *x, const Derived *y, double t, Signals *s)
{
    s->t = t;
    for (int i = 0; i < N; ++i) {
        s->qd[i] = x->offset[i];
        s->dqd[i] = s->ddqd[i] = s->disturbance[i] = 0.0;
    }
    for (int j = 0; j < x->exponentials; ++j) {
        const double rate = x->rate[j], fade = exp(-rate * t);

        for (int i = 0; i < N; ++i) {
            const double part = x->amplitude[j][i] * fade;

            s->qd[i] += part;
            s->dqd[i] -= rate * part;
            s->ddqd[i] += rate * rate * part;
        }
    }
    for (int j = 0; j < x->harmonics; ++j) {
        const Harmonic *const h = &x->harmonic[j];
        const double first = sin(h->frequency[0] * t + h->phase[0]);
        const double second = y->one_sine[j] ? first : sin(h->frequency[1] * t + h->phase[1]);

        s->disturbance[0] += x->scale * h->amplitude[0] * first;
        s->disturbance[1] += x->scale * h->amplitude[1] * second;
    }
    for (int i = 0; i < N; ++i) {
        if (t < x->rho_time[i]) {
            /* (20), (B5) and the second derivative from one power of 1 - t/T */
            const double left = 1.0 - t * y->inv_time[i], power = power_of(left, x->sigma[i] - 2.0);
            const double rho = y->span[i] * power * left * left + x->rho_end[i], inv_rho = 1.0 / rho;

            s->rho[i] = rho;
            s->inv_rho[i] = inv_rho;
            s->alpha[i] = -y->drho[i] * power * left * inv_rho;
            s->dalpha[i] = s->alpha[i] * s->alpha[i] - y->ddrho[i] * power * inv_rho;
        } else {
            s->rho[i] = x->rho_end[i];
            s->inv_rho[i] = y->inv_end[i];
            s->alpha[i] = s->dalpha[i] = 0.0;
        }
    }
}

/* ---- arm ------------------------------------------------------------------------------------------------------- */

typedef struct {
    double q[N], dq[N];
} State;

/* The only trigonometry of the configuration: the plant and the nominal model in the law share it. */
typedef struct {
    double cos_1, cos_2, sin_2, cos_12;
} Pose;

static inline Pose pose_of(const double q[N])
{
    const double c1 = cos(q[0]), s1 = sin(q[0]), c2 = cos(q[1]), s2 = sin(q[1]);

    return (Pose){c1, c2, s2, c1 * c2 - s1 * s2};
}

static inline void mass_matrix(const Arm *arm, const Pose *pose, double *m11, double *m12, double *m22)
{
    *m11 = arm->a + 2.0 * arm->c * pose->cos_2;
    *m12 = arm->b + arm->c * pose->cos_2;
    *m22 = arm->d;
}

/* C(q, q') q' + G(q) */
static inline void bias(const Arm *arm, const Pose *pose, const double dq[N], double out[N])
{
    const double h = arm->c * pose->sin_2, g2 = arm->g2 * pose->cos_12;

    out[0] = -h * dq[1] * (2.0 * dq[0] + dq[1]) + arm->g1 * pose->cos_1 + g2;
    out[1] = h * dq[0] * dq[0] + g2;
}

/* (10) solved for the acceleration of the true arm */
static inline void acceleration(const Arm *arm, const Pose *pose, const double dq[N], const double tau[N],
                                const double d[N], double ddq[N])
{
    double m11, m12, m22, n[N];

    mass_matrix(arm, pose, &m11, &m12, &m22);
    bias(arm, pose, dq, n);
    const double f0 = tau[0] + d[0] - n[0], f1 = tau[1] + d[1] - n[1];
    const double inv_det = 1.0 / (m11 * m22 - m12 * m12);

    ddq[0] = (m22 * f0 - m12 * f1) * inv_det;
    ddq[1] = (m11 * f1 - m12 * f0) * inv_det;
}

/* ---- control law ----------------------------------------------------------------------------------------------- */

/* K1 s^p(x) + K2 s^q(x), (29) and (34), and its slope, (33) and (35): the powers share one logarithm. */
static inline void surface_terms(const Parameters *g, const Derived *y, int i, double x, double *value, double *slope)
{
    const double a = fabs(x), log_a = log(a), power_q = exp((g->q[i] - 1.0) * log_a);
    double sp, fp;

    if (a >= g->delta[i]) {
        const double power_p = exp((g->p[i] - 1.0) * log_a);

        sp = power_p * x;
        fp = g->p[i] * power_p;
    } else {
        sp = x * (y->l1[i] + a * (y->l2[i] + a * y->l3[i]));
        fp = y->l1[i] + a * (2.0 * y->l2[i] + 3.0 * y->l3[i] * a);
    }
    *value = g->k1[i] * sp + g->k2[i] * power_q * x;
    *slope = g->k1[i] * fp + g->k2[i] * g->q[i] * power_q;
}

/* The law (41)-(43), (51), with e = q - q_d given. Not COMPLETED where it has no finite value. */
static inline int control(const Parameters *g, const Derived *y, const Signals *s, const State *x, const Pose *pose,
                          const double e[N], double tau[N])
{
    double surface[N], power[N], wanted[N];

    for (int i = 0; i < N; ++i) {
        /* Written so that a NaN fails it too. */
        if (!(e[i] > y->lower[i] * s->rho[i] && e[i] < y->upper[i] * s->rho[i]))
            return isfinite(e[i]) ? LEFT_ENVELOPE : NOT_FINITE;
    }
    for (int i = 0; i < N; ++i) {
        const double ratio = e[i] * s->inv_rho[i], below = ratio - y->lower[i], above = y->upper[i] - ratio;
        const double inv = 1.0 / (below * above); /* the one division behind both (24) and (27) */
        const double eps1 = log(y->log_scale[i] * below * below * inv);
        const double beta = (y->upper[i] - y->lower[i]) * inv * s->inv_rho[i];
        const double de = x->dq[i] - s->dqd[i], drift = de + s->alpha[i] * e[i]; /* e' + A e */
        double value, slope;

        surface_terms(g, y, i, eps1, &value, &slope);
        surface[i] = drift + value;                                                             /* (40) */
        wanted[i] = s->ddqd[i] - s->dalpha[i] * e[i] - s->alpha[i] * de - slope * beta * drift; /* eps2 by (28) */
    }
    for (int i = 0; i < N; ++i) /* Sig^r(s); a loop of its own lets the joints' chains of log and exp overlap */
        power[i] = power_of(fabs(surface[i]), g->r - 1.0) * surface[i];

    double m11, m12, m22, n[N];

    mass_matrix(&y->nominal, pose, &m11, &m12, &m22);
    bias(&y->nominal, pose, x->dq, n);
    /* tau0 + tau1, (42) and (43): M0 multiplies a part of each, so it is applied once, to their sum. */
    const double f0 = m11 * wanted[0] + m12 * wanted[1] + n[0] - g->k0[0][0] * power[0] - g->k0[0][1] * power[1];
    const double f1 = m12 * wanted[0] + m22 * wanted[1] + n[1] - g->k0[1][0] * power[0] - g->k0[1][1] * power[1];
    const double q_norm = sqrt(x->q[0] * x->q[0] + x->q[1] * x->q[1]);
    const double dq_norm2 = x->dq[0] * x->dq[0] + x->dq[1] * x->dq[1];
    const double u = (g->margin + g->bound0 + g->bound1 * q_norm + g->bound2 * dq_norm2
                      + y->gamma * sqrt(f0 * f0 + f1 * f1))
                     * y->inv_gamma; /* (45) */
    const double push = u / (sqrt(surface[0] * surface[0] + surface[1] * surface[1]) + g->s0);

    tau[0] = f0 - push * surface[0];
    tau[1] = f1 - push * surface[1];
    return isfinite(tau[0]) && isfinite(tau[1]) ? COMPLETED : NOT_FINITE;
}

/* ---- integration ----------------------------------------------------------------------------------------------- */

/* Base state plus h times the derivative (v, a). */
static inline State moved(const State *x, double h, const double v[N], const double a[N])
{
    return (State){{x->q[0] + h * v[0], x->q[1] + h * v[1]}, {x->dq[0] + h * a[0], x->dq[1] + h * a[1]}};
}

/* Acceleration at a later RK4 stage, under the torque of the law there. */
static inline int stage(const Parameters *g, const Derived *y, const State *x, const Signals *s, double ddq[N])
{
    const Pose pose = pose_of(x->q);
    const double e[N] = {x->q[0] - s->qd[0], x->q[1] - s->qd[1]};
    double tau[N];
    const int outcome = control(g, y, s, x, &pose, e, tau);

    if (outcome == COMPLETED)
        acceleration(&y->robot, &pose, x->dq, tau, s->disturbance, ddq);
    return outcome;
}

/* One RK4 step from *x, whose acceleration a1 is known. */
static inline int rk4(const Parameters *g, const Derived *y, State *x, double h, const double a1[N],
                      const Signals *mid, const Signals *end)
{
    double a2[N], a3[N], a4[N];
    const State x2 = moved(x, 0.5 * h, x->dq, a1);
    int outcome = stage(g, y, &x2, mid, a2);

    if (outcome != COMPLETED)
        return outcome;
    const State x3 = moved(x, 0.5 * h, x2.dq, a2);

    outcome = stage(g, y, &x3, mid, a3);
    if (outcome != COMPLETED)
        return outcome;
    const State x4 = moved(x, h, x3.dq, a3);

    outcome = stage(g, y, &x4, end, a4);
    if (outcome != COMPLETED)
        return outcome;
    for (int i = 0; i < N; ++i) {
        x->q[i] += h / 6.0 * (x->dq[i] + 2.0 * (x2.dq[i] + x3.dq[i]) + x4.dq[i]);
        x->dq[i] += h / 6.0 * (a1[i] + 2.0 * (a2[i] + a3[i]) + a4[i]);
    }
    return outcome;
}

/* ---- online tally ---------------------------------------------------------------------------------------------- */

typedef struct {
    long last_above[N][BANDS], samples;
    double steady[N], peak[N], first[N], change[N], late_change[N], iae[N], eci[N], aice[N];
    double margin[N]; /* in units of rho; divided by the envelope's width at the end */
    double previous[N];
} Tally;

static inline void tally_error(Tally *y, const Parameters *g, const Derived *d, long k, bool late, const Signals *s,
                               const double e[N])
{
    for (int i = 0; i < N; ++i) {
        const double a = fabs(e[i]), ratio = e[i] * s->inv_rho[i];
        const double below = ratio - d->lower[i], above = d->upper[i] - ratio, margin = below < above ? below : above;

        for (int j = BANDS - 1; j >= 0 && a > g->band[j]; --j)
            y->last_above[i][j] = k;
        if (late && a > y->steady[i])
            y->steady[i] = a;
        if (s->t > 2.0)
            y->iae[i] += a;
        if (margin < y->margin[i])
            y->margin[i] = margin;
    }
}

static inline void tally_torque(Tally *y, bool previous_late, const double tau[N])
{
    for (int i = 0; i < N; ++i) {
        const double a = fabs(tau[i]);

        y->eci[i] += tau[i] * tau[i];
        if (a > y->peak[i])
            y->peak[i] = a;
        if (y->samples == 0) {
            y->first[i] = a;
        } else {
            const double change = fabs(tau[i] - y->previous[i]);

            y->aice[i] += change;
            if (change > y->change[i])
                y->change[i] = change;
            if (previous_late && change > y->late_change[i])
                y->late_change[i] = change;
        }
        y->previous[i] = tau[i];
    }
    ++y->samples;
}

/* ---- closed loop ----------------------------------------------------------------------------------------------- */

/*
 * Samples k = 0..steps at t(k) = k * period. HELD: the torque held over a period, the plant by one semi-implicit Euler
 * step. CONTINUOUS: RK4, the law evaluated in every stage. Stops at the first state for which the law is undefined.
 */
static inline __attribute__((always_inline)) int loop(const Parameters *parameters, double period, long steps,
                                                      int mode, Tally *result)
{
    const Parameters g = *parameters;
    const Derived y = derive(&g);
    const double late_from = 0.75 * ((double)steps * period);
    State x = {{g.q_start[0], g.q_start[1]}, {g.dq_start[0], g.dq_start[1]}};
    Signals now, mid, end;
    Tally tally = {.margin = {HUGE_VAL, HUGE_VAL}};
    bool late, previous_late = false;
    int outcome = COMPLETED;

    for (int i = 0; i < N; ++i)
        for (int j = 0; j < BANDS; ++j)
            tally.last_above[i][j] = -1;
    signals_at(&g, &y, 0.0, &now);
    for (long k = 0;; ++k, previous_late = late) {
        const Pose pose = pose_of(x.q);
        const double e[N] = {x.q[0] - now.qd[0], x.q[1] - now.qd[1]};
        double tau[N], ddq[N];

        late = now.t >= late_from;
        tally_error(&tally, &g, &y, k, late, &now, e);
        outcome = control(&g, &y, &now, &x, &pose, e, tau);
        if (outcome != COMPLETED)
            break;
        tally_torque(&tally, previous_late, tau);
        if (k == steps)
            break;

        acceleration(&y.robot, &pose, x.dq, tau, now.disturbance, ddq);
        signals_at(&g, &y, (double)(k + 1) * period, &end); /* the next sample's signals too */
        if (mode == HELD) {
            for (int i = 0; i < N; ++i) {
                x.dq[i] += period * ddq[i];
                x.q[i] += period * x.dq[i];
            }
        } else {
            signals_at(&g, &y, ((double)k + 0.5) * period, &mid);
            outcome = rk4(&g, &y, &x, period, ddq, &mid, &end);
            if (outcome != COMPLETED)
                break;
        }
        now = end;
    }
    for (int i = 0; i < N; ++i)
        tally.margin[i] /= y.upper[i] - y.lower[i];
    *result = tally;
    return outcome;
}

/* A loop for each mode, as its code is then the shorter. noipa hides the numbers in main() from the compiler. */
__attribute__((noipa)) static int simulate(const Parameters *parameters, double period, long steps, int mode,
                                           Tally *result)
{
    return mode == HELD ? loop(parameters, period, steps, HELD, result)
                        : loop(parameters, period, steps, CONTINUOUS, result);
}

/* ---- program --------------------------------------------------------------------------------------------------- */

static Parameters example(double scale)
{
    const double pi = 3.14159265358979323846;

    return (Parameters){
        .robot = {{1.0, 0.8}, {0.5, 1.5}, {5.0, 5.0}, 9.8},
        .nominal = {{1.0, 0.8}, {0.6, 1.8}, {6.0, 6.0}, 9.8},
        .exponentials = 2,
        .offset = {1.25, 1.25},
        .amplitude = {{-1.4, 1.0}, {0.35, -0.25}},
        .rate = {1.0, 4.0},
        .harmonics = 2,
        .harmonic = {{{2.0, 1.0}, {1.0, 2.0}, {0.0, 0.5 * pi}}, {{0.5, 0.5}, {200.0 * pi, 200.0 * pi}, {0.0, 0.0}}},
        .scale = scale,
        .rho_start = {0.8, 0.6}, .rho_end = {0.002, 0.002}, .rho_time = {5.0, 6.0}, .sigma = {2.01, 2.01},
        .overshoot = {0.2, 0.2},
        .k1 = {0.2, 0.2}, .k2 = {0.6, 0.6}, .p = {0.5, 0.5}, .q = {1.2, 1.2}, .delta = {0.01, 0.01},
        .k0 = {{0.1, 0.0}, {0.0, 0.1}}, .r = 1.2, .s0 = 0.05,
        .inertia_lo = 0.09, .inertia_hi = 0.2, .margin = 1.0, .bound0 = 12.0, .bound1 = 2.2, .bound2 = 2.8,
        .q_start = {-0.4, 2.5}, .dq_start = {0.0, 0.0},
        .band = {1e-2, 1e-3, 1e-4, 1e-5, 1e-8},
    };
}

static double now_ns(void)
{
    struct timespec ts;

    clock_gettime(CLOCK_MONOTONIC, &ts);
    return 1e9 * (double)ts.tv_sec + (double)ts.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static void print_pair(const char *name, const double *m)
{
    printf("\"%s\": [%.17g, %.17g], ", name, m[0], m[1]);
}

int main(int argc, char **argv)
{
    static const char *const modes[MODES] = {"held", "continuous"};
    static const char *const outcomes[] = {"completed", "left_envelope", "not_finite"};
    const long steps = argc > 2 ? strtol(argv[2], NULL, 10) : 100000;
    const double period = argc > 3 ? strtod(argv[3], NULL) : 1e-4;
    const double scale = argc > 4 ? strtod(argv[4], NULL) : 1.0;
    const long repeats = argc > 5 ? strtol(argv[5], NULL, 10) : 1;
    int mode = 0;

    while (mode < MODES && (argc < 2 || strcmp(argv[1], modes[mode]) != 0))
        ++mode;
    if (argc > 6 || mode == MODES || steps < 1 || !(period > 0.0) || !isfinite(period) || !isfinite(scale)
        || repeats < 1) {
        fprintf(stderr, "usage: %s held|continuous [steps] [period] [disturbance_scale] [repeats]\n", argv[0]);
        return 2;
    }

    double *const ns = malloc((size_t)repeats * sizeof *ns);

    if (ns == NULL) {
        fprintf(stderr, "out of memory\n");
        return 1;
    }

    const Parameters parameters = example(scale);
    Tally tally;
    int outcome = COMPLETED;

    for (long i = 0; i < repeats; ++i) {
        const double start = now_ns();

        outcome = simulate(&parameters, period, steps, mode, &tally);
        /* A run cut short has done fewer steps than it was asked for. */
        ns[i] = (now_ns() - start) / (tally.samples > 0 ? (double)tally.samples : 1.0);
    }
    qsort(ns, (size_t)repeats, sizeof *ns, ascending);
    printf("{\"mode\": \"%s\", \"outcome\": \"%s\", ", modes[mode], outcomes[outcome]);
    print_pair("steady_error", tally.steady);
    print_pair("peak_torque", tally.peak);
    print_pair("initial_torque", tally.first);
    print_pair("max_torque_step", tally.change);
    print_pair("late_max_torque_step", tally.late_change);
    print_pair("iae", tally.iae);
    print_pair("eci", tally.eci);
    print_pair("aice", tally.aice);
    print_pair("min_margin", tally.margin);
    printf("\"last_above\": [");
    for (int j = 0; j < BANDS; ++j)
        printf("%s[%ld, %ld]", j > 0 ? ", " : "", tally.last_above[0][j], tally.last_above[1][j]);
    printf("], \"samples\": %ld, ", tally.samples);
    printf("\"ns_per_step\": {\"min\": %.6g, \"median\": %.6g}, \"repeats\": %ld}\n", ns[0],
           0.5 * (ns[(repeats - 1) / 2] + ns[repeats / 2]), repeats);
    free(ns);
    return 0;
}
