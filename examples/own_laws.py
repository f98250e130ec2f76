"""Twelve laws of the literature as a user writes them: `tests/export/test_own_laws.py` exports them to C."""

import jax.numpy as jnp

import slidax as sx
from slidax.arms.adjusted import inertial_regressor
from slidax.core import PerJoint, Scalar, matvec, parameter, power
from slidax.law import AbstractModelBased


class PDPlus(AbstractModelBased):
    """`τ = M0(q) q̈_d + C0(q, q̇) q̇_d + G0(q) - Kp e - Kd ė`.

    Source: Paden and Panja, Int. J. Control 47, 1988.
    """

    kp: PerJoint = parameter("diagonal of Kp", "N m/rad", "> 0", default=400.0)
    kd: PerJoint = parameter("diagonal of Kd", "N m s/rad", "> 0", default=100.0)

    def __call__(self, t, state, now, following, memory):
        arm, e, de = self.nominal, state.q - now.q, state.dq - now.dq
        tau = matvec(arm.mass(state.q), now.ddq) + matvec(arm.coriolis(state.q, state.dq), now.dq)
        tau = tau + arm.gravity(state.q) - self.kp * e - self.kd * de
        return sx.Command(tau=tau, memory=memory, signals={"e": e})


class IntegralSlidingMode(AbstractModelBased):
    """`τ = M0 (q̈_d - kp e - kd ė - ρ tanh(s/δ)) + C0 q̇ + G0`, `s = ė + kd e + kp z`, `ż = e`, `s(0) = 0`.

    Source: Utkin and Shi, IEEE CDC 1996, with a boundary layer.
    """

    kp: PerJoint = parameter("kp", "1/s²", "> 0", default=100.0)
    kd: PerJoint = parameter("kd", "1/s", "> 0", default=20.0)
    gain: PerJoint = parameter("ρ", "rad/s²", "> 0", default=5.0)
    layer: PerJoint = parameter("δ", "rad/s", "> 0", default=0.05)

    def init(self, t, state, reference):
        e, de = state.q - reference.q, state.dq - reference.dq
        return -(de + self.kd * e) / self.kp

    def __call__(self, t, state, now, following, memory):
        e, de = state.q - now.q, state.dq - now.dq
        s = de + self.kd * e + self.kp * memory
        u = now.ddq - self.kp * e - self.kd * de - self.gain * jnp.tanh(s / self.layer)
        tau = matvec(self.nominal.mass(state.q), u) + self.nominal.bias(state.q, state.dq)
        return sx.Command(tau=tau, memory=memory, signals={"s": s}, rate=e)


class TimeDelayControl(AbstractModelBased):
    """`τ(k) = τ(k-1) + M̄ (q̈_d - kp e - kd ė - (q̇(k) - q̇(k-1))/h)`: the last sample replaces the arm's model.

    Source: Youcef-Toumi and Ito, J. Dyn. Sys. Meas. Control 112, 1990.
    """

    interval: Scalar = parameter("h", "s", "> 0", default=1e-3)
    inertia: PerJoint = parameter("M̄", "kg m²", "> 0", default=2.0)
    kp: PerJoint = parameter("kp", "1/s²", "> 0", default=100.0)
    kd: PerJoint = parameter("kd", "1/s", "> 0", default=20.0)
    limit: PerJoint = parameter("torque of the drives, which stops the sum", "N m", "> 0", default=60.0)

    def init(self, t, state, reference):
        return self.nominal.gravity(state.q), state.dq

    def __call__(self, t, state, now, following, memory):
        tau, dq = memory
        e, de, ddq = state.q - now.q, state.dq - now.dq, (state.dq - dq) / self.interval
        tau = tau + self.inertia * (now.ddq - self.kp * e - self.kd * de - ddq)
        tau = jnp.clip(tau, -self.limit, self.limit)
        return sx.Command(tau=tau, memory=(tau, state.dq), signals={"ddq": ddq})


class Rise(AbstractModelBased):
    """Robust integral of the sign of the error: `τ = τ_d - (ks + 1) e2 - ν`, `e2 = ė + α1 e`.

    `ν̇ = (ks + 1) α2 e2 + β sgn(e2)`, `ν(0) = -(ks + 1) e2(0)`; τ_d is the model's torque along the reference.
    Source: Xian, Dawson, de Queiroz and Chen, IEEE Trans. Autom. Control 49, 2004; τ_d as in Patre, MacKunis, Makkar
    and Dixon, IEEE Trans. Control Syst. Technol. 16, 2008. Here `e = q - q_d`.
    """

    ks: PerJoint = parameter("ks", "N m s/rad", "> 0", default=60.0)
    alpha1: PerJoint = parameter("α1", "1/s", "> 0", default=8.0)
    alpha2: PerJoint = parameter("α2", "1/s", "> 0", default=8.0)
    beta: PerJoint = parameter("β", "N m/s", "> 0", default=20.0)
    limit: PerJoint = parameter("torque of the drives, which stops the integral", "N m", "> 0", default=60.0)

    def init(self, t, state, reference):
        return -(self.ks + 1.0) * (state.dq - reference.dq + self.alpha1 * (state.q - reference.q))

    def __call__(self, t, state, now, following, memory):
        e2 = state.dq - now.dq + self.alpha1 * (state.q - now.q)
        along = matvec(self.nominal.mass(now.q), now.ddq) + self.nominal.bias(now.q, now.dq)
        rate = (self.ks + 1.0) * self.alpha2 * e2 + self.beta * jnp.sign(e2)
        tau = along - (self.ks + 1.0) * e2 - memory
        rate = jnp.where(jnp.abs(tau) < self.limit, rate, 0.0)
        return sx.Command(tau=tau, memory=memory, signals={"e2": e2}, rate=rate)


class L1Adaptive(AbstractModelBased):
    """`τ = M0 (u - η) + C0 q̇ + G0`, `u = q̈_d - kp e - kd ė`: a fast estimate σ̂ of the disturbance, filtered to η.

    Predictor `x̂' = -kp e - kd ė - η + σ̂ - a (x̂ - ė)`, estimate `σ̂ = -a (x̂ - ė) / (exp(a h) - 1)` at each sample,
    filter `η' = ω (σ̂ - η)`. Source: Hovakimyan and Cao, L1 Adaptive Control Theory, SIAM 2010,
    piecewise-constant adaptive law.
    """

    interval: Scalar = parameter("h", "s", "> 0", default=1e-3)
    kp: PerJoint = parameter("kp", "1/s²", "> 0", default=100.0)
    kd: PerJoint = parameter("kd", "1/s", "> 0", default=20.0)
    predictor: PerJoint = parameter("a", "1/s", "> 0", default=10.0)
    bandwidth: PerJoint = parameter("ω", "rad/s", "> 0", default=60.0)
    bound: PerJoint = parameter("bound of |σ̂|", "rad/s²", "> 0", default=10.0)

    def init(self, t, state, reference):
        return state.dq - reference.dq, jnp.zeros_like(state.q)

    def __call__(self, t, state, now, following, memory):
        (predicted, eta), h, a = memory, self.interval, self.predictor
        e, de = state.q - now.q, state.dq - now.dq
        u, growth = -self.kp * e - self.kd * de, jnp.expm1(a * h)
        sigma = jnp.clip(-a * (predicted - de) / growth, -self.bound, self.bound)
        ahead = de + ((predicted - de) + growth / a * (u - eta + sigma)) / (growth + 1.0)
        filtered = eta - jnp.expm1(-self.bandwidth * h) * (sigma - eta)
        tau = matvec(self.nominal.mass(state.q), now.ddq + u - filtered) + self.nominal.bias(state.q, state.dq)
        return sx.Command(tau=tau, memory=(ahead, filtered), signals={"sigma": sigma})


class LinearDisturbanceRejection(AbstractModelBased):
    """LADRC: `τ = M̄ (q̈_d + ωc² (q_d - z1) + 2 ωc (q̇_d - z2) - z3)`, without a model of the arm but M̄.

    z estimates q, q̇ and all other accelerations from positions alone: a third-order observer with its poles at
    `exp(-ωo h)`. Source: Gao, ACC 2003; the current discrete observer of Miklosovic, Radke and Gao, ACC 2006.
    """

    interval: Scalar = parameter("h", "s", "> 0", default=1e-3)
    inertia: PerJoint = parameter("M̄", "kg m²", "> 0", default=2.0)
    bandwidth: PerJoint = parameter("ωc", "rad/s", "> 0", default=12.0)
    observer: PerJoint = parameter("ωo", "rad/s", "> 0", default=120.0)
    limit: PerJoint = parameter("torque of the drives", "N m", "> 0", default=60.0)

    def init(self, t, state, reference):
        tau = self.nominal.gravity(state.q)
        return state.q, state.dq, -tau / self.inertia, tau

    def __call__(self, t, state, now, following, memory):
        (z1, z2, z3, tau), h, pole = memory, self.interval, jnp.exp(-self.observer * self.interval)
        total = z3 + tau / self.inertia
        z1, z2 = z1 + h * z2 + 0.5 * h * h * total, z2 + h * total
        miss = state.q - z1
        z1 = z1 + (1.0 - pole**3) * miss
        z2 = z2 + 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / h * miss
        z3 = z3 + (1.0 - pole) ** 3 / (h * h) * miss
        u = now.ddq + self.bandwidth**2 * (now.q - z1) + 2.0 * self.bandwidth * (now.dq - z2)
        tau = jnp.clip(self.inertia * (u - z3), -self.limit, self.limit)
        return sx.Command(tau=tau, memory=(z1, z2, z3, tau), signals={"z3": z3})


class MomentumObserver(AbstractModelBased):
    """Computed torque less the residual of the generalised momentum: `τ = M0 (q̈_d - kp e - kd ė) + C0 q̇ + G0 - r`.

    `r = ko (M0 q̇ - z)`, `ż = τ + C0ᵀ q̇ - G0 + r`, which follows the disturbance torque as a first-order low-pass.
    Source: De Luca and Mattone, ICRA 2003.
    """

    kp: PerJoint = parameter("kp", "1/s²", "> 0", default=100.0)
    kd: PerJoint = parameter("kd", "1/s", "> 0", default=20.0)
    observer: PerJoint = parameter("ko", "1/s", "> 0", default=60.0)
    limit: PerJoint = parameter("torque of the drives, which z must know", "N m", "> 0", default=60.0)

    def init(self, t, state, reference):
        return matvec(self.nominal.mass(state.q), state.dq)

    def __call__(self, t, state, now, following, memory):
        arm, q, dq = self.nominal, state.q, state.dq
        mass, coriolis, gravity = arm.mass(q), arm.coriolis(q, dq), arm.gravity(q)
        residual = self.observer * (matvec(mass, dq) - memory)
        u = now.ddq - self.kp * (q - now.q) - self.kd * (dq - now.dq)
        tau = jnp.clip(matvec(mass, u) + matvec(coriolis, dq) + gravity - residual, -self.limit, self.limit)
        rate = tau + matvec(coriolis.T, dq) - gravity + residual
        return sx.Command(tau=tau, memory=memory, signals={"residual": residual}, rate=rate)


class AdaptiveSlotineLi(AbstractModelBased):
    """`τ = M0 q̈_r + C0 q̇_r + G0 + Y â - Kd s`, `â' = -Γ Yᵀ s`, `s = q̇ - q̇_r`, `q̇_r = q̇_d - λ e`.

    Y is linear in a body at the tip, a factor of each link's mass, viscous and Coulomb friction. Its Coriolis part is
    `c((q̇+q̇_r)/2) - c((q̇-q̇_r)/2) = C(q, q̇) q̇_r`. Source: Slotine and Li, Int. J. Robotics Research 6, 1987.
    """

    decay: PerJoint = parameter("λ", "1/s", "> 0", default=10.0)
    kd: PerJoint = parameter("diagonal of Kd", "N m s/rad", "> 0", default=40.0)
    body: Scalar = parameter(
        "Γ of the body's mass; a tenth and a hundredth of it for its moments", "", "> 0", default=1.0
    )
    factor: Scalar = parameter("Γ of the links' factors", "", "> 0", default=0.1)
    friction: Scalar = parameter("Γ of the friction", "", "> 0", default=10.0)

    def init(self, t, state, reference):
        return jnp.zeros(10 + 3 * self.joints)

    def __call__(self, t, state, now, following, memory):
        q, dq, n = state.q, state.dq, self.joints
        # `joint_learning` gives the law an arm with the nominal one inside.
        arm = getattr(self.nominal, "nominal", self.nominal)
        arm = arm.rigid_links() if hasattr(arm, "rigid_links") else arm
        v, a = now.dq - self.decay * (q - now.q), now.ddq - self.decay * (dq - now.dq)
        s, rest = dq - v, jnp.zeros_like(q)

        def torque(dq, ddq):
            return inertial_regressor(arm, q, dq, ddq).torque

        links = torque(0.5 * (dq + v), a) - torque(0.5 * (dq - v), rest) + torque(rest, rest)
        regressor = jnp.concatenate([links, jnp.diag(v), jnp.diag(jnp.tanh(v / 0.02))], axis=1)
        gains = jnp.concatenate([
            self.body * jnp.array([1.0] + [0.1] * 3 + [0.01] * 6),
            jnp.zeros(n) + self.factor,
            jnp.zeros(2 * n) + self.friction,
        ])  # fmt: skip
        known = matvec(self.nominal.mass(q), a) + matvec(self.nominal.coriolis(q, dq), v) + self.nominal.gravity(q)
        tau = known + regressor @ memory - self.kd * s
        return sx.Command(tau=tau, memory=memory, signals={"s": s}, rate=-gains * (regressor.T @ s))


class AdaptiveSuperTwisting(AbstractModelBased):
    """`τ = M0 (q̈_d - λ ė - α √|s| sgn(s) - ν) + C0 q̇ + G0`, `ν̇ = β/2 sgn(s)`, `s = ė + λ e`, `β = 2 ε α`.

    α grows while `|s| > μ` and falls else: `α' = growth sgn(|s| - μ)`, and never falls below `least`.
    Source: Shtessel, Taleb and Plestan, Automatica 48, 2012.
    """

    decay: PerJoint = parameter("λ", "1/s", "> 0", default=10.0)
    growth: PerJoint = parameter("ω1 √(γ1/2)", "√(rad/s²)/s", "> 0", default=5.0)
    ratio: Scalar = parameter("ε", "√(rad/s²)", "> 0", default=2.0)
    zone: PerJoint = parameter("μ", "rad/s", "> 0", default=0.01)
    least: PerJoint = parameter("smallest α", "√(rad/s²)", "> 0", default=0.5)

    def init(self, t, state, reference):
        return jnp.zeros_like(state.q) + self.least, jnp.zeros_like(state.q)

    def __call__(self, t, state, now, following, memory):
        alpha, integral = memory
        e, de = state.q - now.q, state.dq - now.dq
        s = de + self.decay * e
        u = now.ddq - self.decay * de - alpha * jnp.sqrt(jnp.abs(s)) * jnp.sign(s) - integral
        tau = matvec(self.nominal.mass(state.q), u) + self.nominal.bias(state.q, state.dq)
        change = self.growth * jnp.where(alpha > self.least, jnp.sign(jnp.abs(s) - self.zone), 1.0)
        rate = (change, self.ratio * alpha * jnp.sign(s))
        return sx.Command(tau=tau, memory=memory, signals={"s": s, "alpha": alpha}, rate=rate)


class BarrierSuperTwisting(AbstractModelBased):
    """`τ = M0 (q̈_d - λ ė - L √|s| sgn(s) + v) + C0 q̇ + G0`, `v̇ = -L² sgn(s)`, `s = ė + λ e`.

    L grows by `growth` until `|s| <= ε/2` for the first time; from then on it is the barrier `L0 √(ε/(ε - |s|))`, which
    keeps s inside ε without a bound of the disturbance. Source: the barrier function of Obeid, Fridman, Laghrouche and
    Harmouche, Automatica 93, 2018, in super-twisting as in Obeid, Laghrouche, Fridman, Chitour and Harmouche, IEEE
    Trans. Autom. Control 65, 2020. A sampled s can jump over ε: `most`, which bounds L, is ours.
    """

    decay: PerJoint = parameter("λ", "1/s", "> 0", default=10.0)
    growth: PerJoint = parameter("rate of L before s was near 0", "√(rad/s²)/s", "> 0", default=5.0)
    base: PerJoint = parameter("L0, L at s = 0", "√(rad/s²)", "> 0", default=1.0)
    width: PerJoint = parameter("ε", "rad/s", "> 0", default=0.05)
    most: PerJoint = parameter("largest L", "√(rad/s²)", "> 0", default=20.0)

    def init(self, t, state, reference):
        zero = jnp.zeros_like(state.q)
        return zero + self.base, zero, zero

    def __call__(self, t, state, now, following, memory):
        grown, reached, v = memory
        e, de = state.q - now.q, state.dq - now.dq
        s = de + self.decay * e
        size = jnp.abs(s)
        reached = jnp.where(size <= 0.5 * self.width, 1.0, reached)
        room = jnp.maximum(self.width - size, self.width * (self.base / self.most) ** 2)
        level = jnp.where(reached > 0.0, self.base * jnp.sqrt(self.width / room), jnp.minimum(grown, self.most))
        u = now.ddq - self.decay * de - level * jnp.sqrt(size) * jnp.sign(s) + v
        tau = matvec(self.nominal.mass(state.q), u) + self.nominal.bias(state.q, state.dq)
        rate = (self.growth * (1.0 - reached), jnp.zeros_like(v), -(level**2) * jnp.sign(s))
        memory = (grown, reached, v)
        return sx.Command(tau=tau, memory=memory, signals={"s": s, "level": level}, rate=rate)


class SampledFunnel(AbstractModelBased):
    """`τ = M0 (q̈_d + u) + C0 q̇ + G0` with `u = -β/e2` once `|e2| >= threshold`, and `u = -kp e - kd ė` below it.

    `e1 = e/ρ`, `e2 = ė/ρ + e1/(1 - e1²)`, `ρ = (ρ0 - ρ∞) (1 - t/T)^σ + ρ∞`, held over a period. Source: Lanza, arXiv
    2402.05688 (relative degree two, where ė is the difference of two samples), and Lanza, Dennstädt, Worthmann,
    Schmitz, Şen, Trenn and Schaller, arXiv 2303.00523, where any bounded input may act below the threshold. Each joint
    has its own funnel here, and the model and the PD law inside are ours.
    """

    initial: PerJoint = parameter("ρ0", "rad", "> 0", default=1.0)
    final: PerJoint = parameter("ρ∞", "rad", "> 0", default=0.02)
    deadline: PerJoint = parameter("T", "s", "> 0", default=2.0)
    exponent: PerJoint = parameter("σ", "", "> 0", default=2.01)
    gain: PerJoint = parameter("β", "rad/s³", "> 0", default=5.0)
    threshold: PerJoint = parameter("activation threshold", "1/s", "> 0", default=0.75)
    kp: PerJoint = parameter("kp", "1/s²", "> 0", default=100.0)
    kd: PerJoint = parameter("kd", "1/s", "> 0", default=20.0)

    def __call__(self, t, state, now, following, memory):
        e, de = state.q - now.q, state.dq - now.dq
        left = jnp.maximum(1.0 - t / self.deadline, 0.0)
        radius = (self.initial - self.final) * power(left, self.exponent) + self.final
        e1 = e / radius
        # A sampled error can jump over its bound, where the quotient would change its sign.
        e2 = de / radius + e1 / jnp.maximum(1.0 - e1**2, 1e-3)
        active = jnp.abs(e2) >= self.threshold
        u = jnp.where(active, -self.gain / jnp.where(active, e2, 1.0), -self.kp * e - self.kd * de)
        tau = matvec(self.nominal.mass(state.q), now.ddq + u) + self.nominal.bias(state.q, state.dq)
        return sx.Command(tau=tau, memory=memory, signals={"e2": e2})


class PrescribedTime(AbstractModelBased):
    """`τ = g (M0 q̈_d + C0 q̇_d + G0) - M̄ (k2 z + μ1 h2 ξ1 + r2 â Φ z)/μ2`: a prescribed accuracy at a prescribed time.

    `ξ1 = e/h1(e/(F1 β))`, `ξ2 = q̇/h2(q̇/F2)`, `β = (1 - b) (1 - t/T)³ + b`, `b = ε/(√n F1)`, with bumps h that are 1 at
    0 and 0 at the bounds; μ1, μ2 are the slopes of ξ1 and ξ2, ν that of ξ1 over β times β̇. `z = ξ2 - α`,
    `α = -(k1 + r1 (‖μ1‖² (‖h2‖² + ‖q_d‖²) + ‖ν‖²)) ξ1/(μ1 h2)`, `â' = r4 Φ ‖z‖² - r3 â`.

    Source: the MATLAB code of Cao, Cao and Song, practical prescribed-time tracking control with prescribed accuracy
    (IEEE Trans. Cybernetics, CYB-E-2020-09-2426). There M̄ = 1 and g = 0: no model is used. Φ is the norm of a network
    of 1000 random Gaussians there, and a constant here; α passes a filter whose time constant is the step there.
    """

    bound: PerJoint = parameter("F1, bound of e at the start", "rad", "> 0", default=2.0)
    speed: PerJoint = parameter("F2, bound of q̇", "rad/s", "> 0", default=4.0)
    accuracy: Scalar = parameter("ε, bound of ‖e‖ from T on", "rad", "> 0", default=0.1)
    deadline: PerJoint = parameter("T", "s", "> 0", default=2.0)
    k1: PerJoint = parameter("k1", "1/s", "> 0", default=4.0)
    r1: PerJoint = parameter("r1", "1/s", "> 0", default=2.0)
    k2: PerJoint = parameter("k2", "N m s/rad", "> 0", default=15.0)
    r2: PerJoint = parameter("r2", "", "> 0", default=10.0)
    r3: Scalar = parameter("r3", "1/s", "> 0", default=2.0)
    r4: Scalar = parameter("r4", "", "> 0", default=25.0)
    activity: Scalar = parameter("Φ", "", "> 0", default=0.6)
    inertia: PerJoint = parameter("M̄", "", "> 0", default=1.0)
    model: Scalar = parameter("g, share of the model's torque", "", "[0, 1]", default=0.0)

    def init(self, t, state, reference):
        return jnp.zeros(())

    def __call__(self, t, state, now, following, memory):
        arm, e, dq = self.nominal, state.q - now.q, state.dq
        b = self.accuracy / (jnp.sqrt(1.0 * self.joints) * self.bound)
        left = jnp.maximum(1.0 - t / self.deadline, 0.0)
        beta, beta_rate = (1.0 - b) * left**3 + b, -3.0 * (1.0 - b) * left**2 / self.deadline
        # A sampled error can jump over its bound, where the bumps are zero.
        x, y = jnp.clip(e / (self.bound * beta), -0.95, 0.95), jnp.clip(dq / self.speed, -0.95, 0.95)
        size, fast = jnp.abs(x), jnp.abs(y)
        h1, h1_slope = 1.0 - size**3 * (10.0 - 15.0 * size + 6.0 * size**2), -30.0 * x * size * (1.0 - size) ** 2
        h2, h2_slope = 1.0 - fast**2 * (3.0 - 2.0 * fast), -6.0 * y * (1.0 - fast)
        mu1, nu = 1.0 / h1 - x * h1_slope / h1**2, x**2 * self.bound * h1_slope * beta_rate / h1**2
        mu2, xi1, xi2 = 1.0 / h2 - y * h2_slope / h2**2, e / h1, dq / h2
        phi = jnp.max(mu1**2) * (jnp.max(h2**2) + jnp.sum(now.q**2)) + jnp.sum(nu**2)
        z = xi2 + (self.k1 + self.r1 * phi) * xi1 / (mu1 * h2)
        u = (self.k2 * z + mu1 * h2 * xi1 + self.r2 * memory * self.activity * z) / mu2
        along = matvec(arm.mass(now.q), now.ddq) + arm.bias(now.q, now.dq)
        rate = self.r4 * self.activity * jnp.sum(z**2) - self.r3 * memory
        tau = self.model * along - self.inertia * u
        return sx.Command(tau=tau, memory=memory, signals={"z": z, "adapted": memory}, rate=rate)


LAWS = (
    PDPlus,
    IntegralSlidingMode,
    TimeDelayControl,
    Rise,
    L1Adaptive,
    LinearDisturbanceRejection,
    MomentumObserver,
    AdaptiveSlotineLi,
    AdaptiveSuperTwisting,
    BarrierSuperTwisting,
    SampledFunnel,
    PrescribedTime,
)
