/*
 * Example 4.1 of "Approximate continuous fixed-time terminal sliding mode control with prescribed performance for
 * uncertain robotic manipulators" (Nonlinear Dynamics, 2022, doi 10.1007/s11071-022-07650-w): a two-link arm under the
 * CFTSMPPC law (51), written by hand as a referee for other implementations and as a yardstick of speed.
 * Numbers in parentheses are the paper's equations.
 *
 *   gcc -O3 -march=native example_4_1.c -o example_4_1 -lm
 *   ./example_4_1 held|continuous|held_rk4 [steps] [period] [disturbance_scale] [repeats]
 *
 * Define EXAMPLE_4_1_NO_MAIN to build only the function. Don't build with -ffast-math where a run may leave the
 * envelope: it lets the compiler drop the tests for NaN.
 */
#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { HELD, CONTINUOUS, HELD_RK4, MODES };        /* the modes of example_4_1() */
enum { COMPLETED, LEFT_ENVELOPE, NOT_FINITE };     /* what it returns; -1 for arguments out of range */
enum { BANDS = 5 };

/* Where example_4_1() puts each metric; all but the EXIT_ ones are one number per joint. */
enum {
    SETTLING = 0,                            /* BANDS pairs: last sample time with |e| above the band, -1 if none */
    STEADY_ERROR = SETTLING + 2 * BANDS,     /* max |e| over t >= 3/4 of the whole run */
    PEAK_TORQUE = STEADY_ERROR + 2,          /* max |tau| */
    INITIAL_TORQUE = PEAK_TORQUE + 2,        /* |tau(0)| */
    TORQUE_STEP = INITIAL_TORQUE + 2,        /* max |tau(k+1) - tau(k)| */
    LATE_TORQUE_STEP = TORQUE_STEP + 2,      /* the same over t(k) >= 3/4 of the whole run */
    IAE = LATE_TORQUE_STEP + 2,              /* (80) sum of |e| over t > 2 s */
    ECI = IAE + 2,                           /* (81) sum of tau^2 */
    AICE = ECI + 2,                          /* (82) sum of |tau(k+1) - tau(k)| */
    MARGIN = AICE + 2,                       /* min distance to the nearer bound, over the envelope's width */
    SAMPLES_OUTSIDE = MARGIN + 2,            /* samples with any joint at or outside a bound */
    SAMPLES,                                 /* samples whose torque was evaluated */
    EXIT_JOINT,                              /* 0 or 1, -1 if the run was completed; so the three that follow */
    EXIT_TIME,
    EXIT_ERROR,
    EXIT_BOUND,
    METRICS
};

int example_4_1(double period, long steps, int mode, double disturbance_scale, double *metrics_out);

/* ---- parameters: Table 1, row CFTSMPPC, and the arm ------------------------------------------------------------ */

static const double rho_start[2] = {0.8, 0.6}, rho_end[2] = {0.002, 0.002}, rho_time[2] = {5.0, 6.0};
static const double sigma = 2.01, s0 = 0.05;
static const double p = 0.5, q_exp = 1.2, r = 1.2, delta = 0.01;
static const double gain_k0 = 0.1, gain_k1 = 0.2, gain_k2 = 0.6, gain_k = 1.0;
static const double bound0 = 12.0, bound1 = 2.2, bound2 = 2.8;
static const double inertia_lo = 0.09, inertia_hi = 0.2; /* m1, m2 of (47) */

/* (13) with theta = 0.2: e(0) = (-0.6, 0.5), so joint 1 may overshoot upwards and joint 2 downwards. */
static const double lower[2] = {-1.0, -0.2}, upper[2] = {0.2, 1.0};

static const double q_start[2] = {-0.4, 2.5};
static const double band[BANDS] = {1e-2, 1e-3, 1e-4, 1e-5, 1e-8}; /* decreasing: tally_error() relies on it */
static const double pi = 3.14159265358979323846;

/* M = [a + 2c cos q2, b + c cos q2; ., d], h = c sin q2, G = [g1 cos q1 + g2 cos(q1 + q2); g2 cos(q1 + q2)] */
typedef struct {
    double a, b, c, d, g1, g2;
} Arm;

#define L1 1.0
#define L2 0.8
#define GRAVITY 9.8
#define ARM(m1, m2, i1, i2)                                                                                     \
    {                                                                                                           \
        ((m1) + (m2)) * L1 * L1 + (m2) * L2 * L2 + (i1), (m2) * L2 * L2, (m2) * L1 * L2, (m2) * L2 * L2 + (i2), \
            ((m1) + (m2)) * L1 * GRAVITY, (m2) * L2 * GRAVITY                                                   \
    }

static const Arm true_arm = ARM(0.5, 1.5, 5.0, 5.0), nominal_arm = ARM(0.6, 1.8, 6.0, 6.0);

/* x^y for x >= 0. Faster than pow(), and as |y| < 1 and x is no extreme here the same to an ulp or two. */
static inline double power_of(double x, double y)
{
    return exp(y * log(x));
}

/* ---- what depends on time alone -------------------------------------------------------------------------------- */

typedef struct {
    double t;
    double qd[2], dqd[2], ddqd[2];                  /* reference */
    double rho[2], inv_rho[2], alpha[2], dalpha[2]; /* (20), its reciprocal, (26) and the diagonal of A' */
    double disturbance[2];
} Signals;

static inline void disturbance_at(double t, double scale, double d[2])
{
    const double sin_t = sin(t), ripple = 0.5 * sin(200.0 * pi * t);

    d[0] = scale * (2.0 * sin_t + ripple);
    d[1] = scale * (1.0 - 2.0 * sin_t * sin_t + ripple); /* cos 2t */
}

static inline void signals_at(double t, double scale, Signals *s)
{
    const double e1 = exp(-t), e2 = e1 * e1, e4 = e2 * e2;

    s->t = t;
    s->qd[0] = 1.25 - 1.4 * e1 + 0.35 * e4;
    s->qd[1] = 1.25 + e1 - 0.25 * e4;
    s->dqd[0] = 1.4 * (e1 - e4);
    s->dqd[1] = e4 - e1;
    s->ddqd[0] = 5.6 * e4 - 1.4 * e1;
    s->ddqd[1] = e1 - 4.0 * e4;
    for (int i = 0; i < 2; ++i) {
        if (t < rho_time[i]) {
            /* (20), (B5) and the second derivative from one power of 1 - t/T */
            const double span = rho_start[i] - rho_end[i], left = 1.0 - t / rho_time[i];
            const double power = power_of(left, sigma - 2.0); /* left^(sigma - 2) */
            const double rho = span * power * left * left + rho_end[i], inv_rho = 1.0 / rho;
            const double drho = -(sigma / rho_time[i]) * span * power * left;
            const double ddrho = sigma * (sigma - 1.0) / (rho_time[i] * rho_time[i]) * span * power;

            s->rho[i] = rho;
            s->inv_rho[i] = inv_rho;
            s->alpha[i] = -drho * inv_rho;
            s->dalpha[i] = s->alpha[i] * s->alpha[i] - ddrho * inv_rho; /* -(rho'' rho - rho'^2) / rho^2 */
        } else {
            s->rho[i] = rho_end[i];
            s->inv_rho[i] = 1.0 / rho_end[i];
            s->alpha[i] = 0.0;
            s->dalpha[i] = 0.0;
        }
    }
    disturbance_at(t, scale, s->disturbance);
}

/* ---- arm ------------------------------------------------------------------------------------------------------- */

typedef struct {
    double q[2], dq[2];
} State;

/* The only trigonometry of the configuration: the plant and the nominal model in the law share it. */
typedef struct {
    double cos_1, cos_2, sin_2, cos_12;
} Pose;

static inline Pose pose_of(const double q[2])
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
static inline void bias(const Arm *arm, const Pose *pose, const double dq[2], double out[2])
{
    const double h = arm->c * pose->sin_2, g2 = arm->g2 * pose->cos_12;

    out[0] = -h * dq[1] * (2.0 * dq[0] + dq[1]) + arm->g1 * pose->cos_1 + g2;
    out[1] = h * dq[0] * dq[0] + g2;
}

/* (10) solved for the acceleration of the true arm */
static inline void acceleration(const Pose *pose, const double dq[2], const double tau[2], const double d[2],
                                double ddq[2])
{
    double m11, m12, m22, n[2];

    mass_matrix(&true_arm, pose, &m11, &m12, &m22);
    bias(&true_arm, pose, dq, n);
    const double f0 = tau[0] + d[0] - n[0], f1 = tau[1] + d[1] - n[1];
    const double inv_det = 1.0 / (m11 * m22 - m12 * m12);

    ddq[0] = (m22 * f0 - m12 * f1) * inv_det;
    ddq[1] = (m11 * f1 - m12 * f0) * inv_det;
}

/* ---- control law ----------------------------------------------------------------------------------------------- */

/* K1 s^p(x) + K2 s^q(x), (29) and (34), and its slope, (33) and (35): a part and its slope share one power. */
static inline void surface_terms(double x, double *value, double *slope)
{
    const double a = fabs(x), power_q = power_of(a, q_exp - 1.0);
    double sp, fp;

    if (a >= delta) {
        const double power_p = power_of(a, p - 1.0);

        sp = power_p * x; /* |x|^(p-1) x is sig^p(x) */
        fp = p * power_p;
    } else {
        /* (30)-(32); powers of constants, folded by the compiler */
        const double l1 = (0.5 * p * p - 2.5 * p + 3.0) * pow(delta, p - 1.0);
        const double l2 = (-p * p + 4.0 * p - 3.0) * pow(delta, p - 2.0);
        const double l3 = (0.5 * p * p - 1.5 * p + 1.0) * pow(delta, p - 3.0);

        sp = x * (l1 + a * (l2 + a * l3));
        fp = l1 + a * (2.0 * l2 + 3.0 * l3 * a);
    }
    *value = gain_k1 * sp + gain_k2 * power_q * x;
    *slope = gain_k1 * fp + gain_k2 * q_exp * power_q;
}

typedef struct {
    int outcome, joint;
    double t, error, bound;
} Exit;

/* The law (41)-(43), (51), with e = q - q_d given. False, with *out filled in, where the law has no finite value. */
static inline bool control(const Signals *s, const State *x, const Pose *pose, const double e[2], double tau[2],
                           Exit *out)
{
    const double gamma = (inertia_hi - inertia_lo) / (inertia_hi + inertia_lo); /* (46) */
    double surface[2], reaching[2], wanted[2];

    for (int i = 0; i < 2; ++i) {
        /* Written so that a NaN fails it too. */
        if (!(e[i] > lower[i] * s->rho[i] && e[i] < upper[i] * s->rho[i])) {
            const double side = e[i] > 0.0 ? upper[i] : lower[i];

            *out = (Exit){isfinite(e[i]) ? LEFT_ENVELOPE : NOT_FINITE, i, s->t, e[i], side * s->rho[i]};
            return false;
        }
    }
    for (int i = 0; i < 2; ++i) {
        const double ratio = e[i] * s->inv_rho[i], below = ratio - lower[i], above = upper[i] - ratio;
        const double inv = 1.0 / (below * above); /* the one division behind both (24) and (27) */
        const double eps1 = log(upper[i] / -lower[i] * below * below * inv);
        const double beta = (upper[i] - lower[i]) * inv * s->inv_rho[i];
        const double de = x->dq[i] - s->dqd[i], drift = de + s->alpha[i] * e[i]; /* e' + A e */
        double value, slope;

        surface_terms(eps1, &value, &slope);
        surface[i] = drift + value;                                                             /* (40) */
        wanted[i] = s->ddqd[i] - s->dalpha[i] * e[i] - s->alpha[i] * de - slope * beta * drift; /* eps2 by (28) */
    }

    for (int i = 0; i < 2; ++i) /* K0 Sig^r(s); a loop of its own lets the joints' chains of log and exp overlap */
        reaching[i] = gain_k0 * power_of(fabs(surface[i]), r - 1.0) * surface[i];

    double m11, m12, m22, n[2];

    mass_matrix(&nominal_arm, pose, &m11, &m12, &m22);
    bias(&nominal_arm, pose, x->dq, n);
    /* tau0 + tau1, (42) and (43): M0 multiplies a part of each, so it is applied once, to their sum. */
    const double f0 = m11 * wanted[0] + m12 * wanted[1] + n[0] - reaching[0];
    const double f1 = m12 * wanted[0] + m22 * wanted[1] + n[1] - reaching[1];
    const double q_norm = sqrt(x->q[0] * x->q[0] + x->q[1] * x->q[1]);
    const double dq_norm2 = x->dq[0] * x->dq[0] + x->dq[1] * x->dq[1];
    const double u = (gain_k + bound0 + bound1 * q_norm + bound2 * dq_norm2 + gamma * sqrt(f0 * f0 + f1 * f1))
                     * (1.0 / (1.0 - gamma)); /* (45) */
    const double push = u / (sqrt(surface[0] * surface[0] + surface[1] * surface[1]) + s0);

    tau[0] = f0 - push * surface[0];
    tau[1] = f1 - push * surface[1];
    if (!(isfinite(tau[0]) && isfinite(tau[1]))) {
        const int i = isfinite(tau[0]) ? 1 : 0;

        *out = (Exit){NOT_FINITE, i, s->t, e[i], (e[i] > 0.0 ? upper[i] : lower[i]) * s->rho[i]};
        return false;
    }
    return true;
}

/* ---- integration ----------------------------------------------------------------------------------------------- */

/* Base state plus h times the derivative (v, a). */
static inline State moved(const State *x, double h, const double v[2], const double a[2])
{
    return (State){{x->q[0] + h * v[0], x->q[1] + h * v[1]}, {x->dq[0] + h * a[0], x->dq[1] + h * a[1]}};
}

/* Acceleration at a later RK4 stage, the torque either held or that of the law at the stage. */
static inline bool stage(const State *x, const Signals *s, bool held, const double tau_held[2], double ddq[2],
                         Exit *out)
{
    const Pose pose = pose_of(x->q);

    if (held) {
        acceleration(&pose, x->dq, tau_held, s->disturbance, ddq);
    } else {
        const double e[2] = {x->q[0] - s->qd[0], x->q[1] - s->qd[1]};
        double tau[2];

        if (!control(s, x, &pose, e, tau, out))
            return false;
        acceleration(&pose, x->dq, tau, s->disturbance, ddq);
    }
    return true;
}

/* One RK4 step from *x, whose torque and acceleration a1 are known. */
static inline bool rk4(State *x, double h, const double a1[2], const Signals *mid, const Signals *end, bool held,
                       const double tau[2], Exit *out)
{
    double a2[2], a3[2], a4[2];
    const State x2 = moved(x, 0.5 * h, x->dq, a1);

    if (!stage(&x2, mid, held, tau, a2, out))
        return false;
    const State x3 = moved(x, 0.5 * h, x2.dq, a2);

    if (!stage(&x3, mid, held, tau, a3, out))
        return false;
    const State x4 = moved(x, h, x3.dq, a3);

    if (!stage(&x4, end, held, tau, a4, out))
        return false;
    for (int i = 0; i < 2; ++i) {
        x->q[i] += h / 6.0 * (x->dq[i] + 2.0 * (x2.dq[i] + x3.dq[i]) + x4.dq[i]);
        x->dq[i] += h / 6.0 * (a1[i] + 2.0 * (a2[i] + a3[i]) + a4[i]);
    }
    return true;
}

/* ---- online tally ---------------------------------------------------------------------------------------------- */

typedef struct {
    long last_above[2][BANDS], outside, samples;
    double steady[2], peak[2], first[2], change[2], late_change[2], iae[2], eci[2], aice[2];
    double margin[2];  /* in units of rho; divided by the envelope's width at the end */
    double previous[2];
} Tally;

static inline void tally_error(Tally *y, long k, bool late, const Signals *s, const double e[2])
{
    bool outside = false;

    for (int i = 0; i < 2; ++i) {
        const double a = fabs(e[i]), ratio = e[i] * s->inv_rho[i];
        const double below = ratio - lower[i], above = upper[i] - ratio, margin = below < above ? below : above;

        for (int j = BANDS - 1; j >= 0 && a > band[j]; --j)
            y->last_above[i][j] = k;
        if (late && a > y->steady[i])
            y->steady[i] = a;
        if (s->t > 2.0)
            y->iae[i] += a;
        if (margin < y->margin[i])
            y->margin[i] = margin;
        outside |= !(e[i] > lower[i] * s->rho[i] && e[i] < upper[i] * s->rho[i]);
    }
    y->outside += outside;
}

static inline void tally_torque(Tally *y, bool previous_late, const double tau[2])
{
    for (int i = 0; i < 2; ++i) {
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

static void report(const Tally *y, double period, const Exit *out, double *m)
{
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < BANDS; ++j)
            m[SETTLING + 2 * j + i] = y->last_above[i][j] < 0 ? -1.0 : (double)y->last_above[i][j] * period;
        m[STEADY_ERROR + i] = y->steady[i];
        m[PEAK_TORQUE + i] = y->peak[i];
        m[INITIAL_TORQUE + i] = y->first[i];
        m[TORQUE_STEP + i] = y->change[i];
        m[LATE_TORQUE_STEP + i] = y->late_change[i];
        m[IAE + i] = y->iae[i];
        m[ECI + i] = y->eci[i];
        m[AICE + i] = y->aice[i];
        m[MARGIN + i] = y->margin[i] / (upper[i] - lower[i]);
    }
    m[SAMPLES_OUTSIDE] = (double)y->outside;
    m[SAMPLES] = (double)y->samples;
    m[EXIT_JOINT] = out->joint;
    m[EXIT_TIME] = out->t;
    m[EXIT_ERROR] = out->error;
    m[EXIT_BOUND] = out->bound;
}

/* ---- closed loop ----------------------------------------------------------------------------------------------- */

/*
 * Samples k = 0..steps at t(k) = k * period; the torque is evaluated at the last one too, the plant isn't advanced.
 *   HELD        torque held over a period, plant by one semi-implicit Euler step
 *   CONTINUOUS  RK4, the law evaluated in every stage, as a fixed-step solver does; tau(k) is the first stage's
 *   HELD_RK4    torque held over a period, plant by one RK4 step
 * Stops at the first state for which the law is undefined: at a sample, or in CONTINUOUS inside a step as well.
 * Metrics up to there are kept. Returns COMPLETED, LEFT_ENVELOPE, NOT_FINITE, or -1 for arguments out of range.
 */
int example_4_1(double period, long steps, int mode, double disturbance_scale, double *metrics_out)
{
    if (!(period > 0.0) || steps < 0 || mode < 0 || mode >= MODES)
        return -1;

    const double late_from = 0.75 * ((double)steps * period);
    State x = {{q_start[0], q_start[1]}, {0.0, 0.0}};
    Signals now, mid = {.t = 0.0}, end;
    Exit out = {COMPLETED, -1, -1.0, 0.0, 0.0};
    Tally tally = {.margin = {HUGE_VAL, HUGE_VAL}};
    bool late, previous_late = false;

    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < BANDS; ++j)
            tally.last_above[i][j] = -1;

    signals_at(0.0, disturbance_scale, &now);
    for (long k = 0;; ++k, previous_late = late) {
        const Pose pose = pose_of(x.q);
        const double e[2] = {x.q[0] - now.qd[0], x.q[1] - now.qd[1]};
        double tau[2], ddq[2];

        late = now.t >= late_from;
        tally_error(&tally, k, late, &now, e);
        if (!control(&now, &x, &pose, e, tau, &out))
            break;
        tally_torque(&tally, previous_late, tau);
        if (k == steps)
            break;

        acceleration(&pose, x.dq, tau, now.disturbance, ddq);
        signals_at((double)(k + 1) * period, disturbance_scale, &end); /* the next sample's signals too */
        if (mode == HELD) {
            for (int i = 0; i < 2; ++i) {
                x.dq[i] += period * ddq[i];
                x.q[i] += period * x.dq[i];
            }
        } else {
            const bool held = mode == HELD_RK4;

            mid.t = ((double)k + 0.5) * period;
            if (held)
                disturbance_at(mid.t, disturbance_scale, mid.disturbance);
            else
                signals_at(mid.t, disturbance_scale, &mid);
            if (!rk4(&x, period, ddq, &mid, &end, held, tau, &out))
                break;
        }
        now = end;
    }
    report(&tally, period, &out, metrics_out);
    return out.outcome;
}

/* ---- program --------------------------------------------------------------------------------------------------- */

#ifndef EXAMPLE_4_1_NO_MAIN

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

/* JSON has no NaN or infinity. */
static void print_number(double x)
{
    if (isfinite(x))
        printf("%.17g", x);
    else
        printf("null");
}

static void print_pair(const char *name, const double *m)
{
    printf("\"%s\": [", name);
    print_number(m[0]);
    printf(", ");
    print_number(m[1]);
    printf("], ");
}

static void print_json(const char *mode, long steps, double period, double scale, int outcome, const double *m)
{
    static const char *const outcomes[] = {"completed", "left_envelope", "not_finite"};
    static const char *const band_names[BANDS] = {"1e-2", "1e-3", "1e-4", "1e-5", "1e-8"};
    static const struct {
        const char *name;
        int at;
    } pairs[] = {
        {"steady_error", STEADY_ERROR}, {"peak_torque", PEAK_TORQUE},
        {"initial_torque", INITIAL_TORQUE}, {"max_torque_step", TORQUE_STEP},
        {"late_max_torque_step", LATE_TORQUE_STEP}, {"iae", IAE},
        {"eci", ECI}, {"aice", AICE},
        {"min_margin", MARGIN},
    };

    printf("{\"mode\": \"%s\", \"steps\": %ld, \"period\": %.17g, \"disturbance_scale\": %.17g, ", mode, steps, period,
           scale);
    printf("\"outcome\": \"%s\", \"exit\": ", outcomes[outcome]);
    if (outcome == COMPLETED) {
        printf("null, ");
    } else {
        printf("{\"joint\": %d, \"time\": %.17g, \"error\": ", (int)m[EXIT_JOINT], m[EXIT_TIME]);
        print_number(m[EXIT_ERROR]);
        printf(", \"bound\": ");
        print_number(m[EXIT_BOUND]);
        printf("}, ");
    }
    printf("\"settling\": {");
    for (int j = 0; j < BANDS; ++j) {
        printf("%s\"%s\": [", j > 0 ? ", " : "", band_names[j]);
        for (int i = 0; i < 2; ++i) {
            const double t = m[SETTLING + 2 * j + i];

            printf("%s", i > 0 ? ", " : "");
            print_number(t < 0.0 ? HUGE_VAL : t);
        }
        printf("]");
    }
    printf("}, ");
    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; ++i)
        print_pair(pairs[i].name, m + pairs[i].at);
    printf("\"samples_outside\": %.0f, \"samples\": %.0f, ", m[SAMPLES_OUTSIDE], m[SAMPLES]);
}

int main(int argc, char **argv)
{
    static const char *const names[MODES] = {"held", "continuous", "held_rk4"};
    long steps = 100000, repeats = 1;
    double period = 1e-4, scale = 1.0, m[METRICS];
    int mode = 0, outcome = COMPLETED;
    char *rest[4] = {"", "", "", ""}; /* what strtol and strtod left unread: nothing, if all is well */

    while (mode < MODES && (argc < 2 || strcmp(argv[1], names[mode]) != 0))
        ++mode;
    if (argc > 2)
        steps = strtol(argv[2], &rest[0], 10);
    if (argc > 3)
        period = strtod(argv[3], &rest[1]);
    if (argc > 4)
        scale = strtod(argv[4], &rest[2]);
    if (argc > 5)
        repeats = strtol(argv[5], &rest[3], 10);
    if (argc > 6 || mode == MODES || *rest[0] || *rest[1] || *rest[2] || *rest[3] || steps < 1 || !(period > 0.0)
        || !isfinite(period) || !isfinite(scale) || repeats < 1) {
        fprintf(stderr, "usage: %s held|continuous|held_rk4 [steps] [period] [disturbance_scale] [repeats]\n", argv[0]);
        return 2;
    }

    double *const ns = malloc((size_t)repeats * sizeof *ns);

    if (ns == NULL) {
        fprintf(stderr, "out of memory\n");
        return 1;
    }
    for (long i = 0; i < repeats; ++i) {
        const double start = now_ns();

        outcome = example_4_1(period, steps, mode, scale, m);
        if (outcome < 0) { /* can't happen: the arguments were checked above */
            free(ns);
            return 2;
        }
        /* A run cut short has done fewer steps than it was asked for. */
        ns[i] = (now_ns() - start) / (m[SAMPLES] > 0.0 ? m[SAMPLES] : 1.0);
    }
    qsort(ns, (size_t)repeats, sizeof *ns, ascending);
    print_json(names[mode], steps, period, scale, outcome, m);
    printf("\"ns_per_step\": {\"min\": %.6g, \"median\": %.6g}, \"repeats\": %ld}\n", ns[0],
           0.5 * (ns[(repeats - 1) / 2] + ns[repeats / 2]), repeats);
    free(ns);
    return 0;
}

#endif
