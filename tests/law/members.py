"""Members of each family of laws and parts, for two joints: one line enrols a new member in `tests/laws/`."""

from typing import NamedTuple

import numpy as np

from slidax.arms import AbstractRobot
from slidax.core.types import State
from slidax.law import (
    AbstractAdaptation,
    AbstractBound,
    AbstractController,
    AbstractEstimator,
    AbstractPerformance,
    AbstractReaching,
    AbstractSurface,
    AbstractTransformation,
    ArmLearning,
    Exponential,
    FilteredDifference,
    FiniteTime,
    FixedBound,
    FixedTime,
    FixedTimeReaching,
    JointLearning,
    Kalman,
    KnownArm,
    KnownJoints,
    Linear,
    LinearCoreFixedTime,
    Measured,
    PrescribedPerformance,
    Recovery,
    RobustDifferentiator,
    SampledData,
    SaturatedReaching,
    SingularityFree,
    SmoothFixedTime,
    StateBound,
    StrongTracking,
    TwoPowerReaching,
    UncertaintyBound,
    Unconstrained,
    sampled_data,
)
from slidax.motions import AbstractMotion
from slidax.plant import TorqueLimits
from tests.paper_examples import (
    ENVELOPE_4_1,
    ENVELOPE_4_2,
    MOTION_4_1,
    MOTION_4_2,
    SCARA,
    START_4_1,
    START_4_2,
    TWO_LINK,
    law_4_1,
    law_4_2,
)
from tests.rivals import (
    AROUND_4_1,
    AROUND_4_2,
    anftsmc_4_2,
    computed_torque_4_1,
    ftsmc_4_1,
    ftsmppc_4_1,
    gravity_pd_4_1,
    nftsmc_4_2,
    pid_4_1,
    sfsmc_4_2,
    slotine_li_4_1,
    super_twisting_4_2,
)

ADAPTATIONS: list[tuple[str, AbstractAdaptation]] = [
    ("joint_learning", JointLearning(rotor=0.1, rotor_min=0.01, rotor_max=2.0, coulomb_max=3.0)),
    ("joint_learning_of_inertia_alone", JointLearning(counted=[0.1, 0.0], rotor=[0.1, 0.02], rotor_max=[1.0, 5.0])),
    ("arm_learning", ArmLearning(joints=JointLearning(rotor=0.1, rotor_max=2.0, coulomb_max=3.0))),
    ("known_arm", KnownArm(payload=[0.5, 0.1, *[0.0] * 8], viscous=0.1, first=0.2, rotor=[0.05, 0.2])),
    ("known_joints", KnownJoints(counted=0.1, rotor=[0.05, 0.2], coulomb=[0.0, 0.4])),
]


PERFORMANCES: list[tuple[str, AbstractPerformance]] = [
    ("fixed_time_4_1", ENVELOPE_4_1),
    ("fixed_time_4_2", ENVELOPE_4_2),
    ("fixed_time_figure_1", FixedTime([0.5, 100.0, 0.5, 100.0], 0.01, [2.0, 2.0, 5.0, 5.0], 2.01)),
    ("exponential", Exponential([0.8, 0.6], 0.002, [1.0, 1.5])),
    ("finite_time", FiniteTime([0.8, 0.6], 0.002, [0.5, 0.4], 0.6)),
]

PERFORMANCES_LIKE_OTHERS = ("fixed_time_4_1", "fixed_time_4_2")
"""The same classes with other numbers: these run in the long version."""


TRANSFORMATIONS: list[tuple[str, AbstractTransformation]] = [
    ("prescribed_performance_4_1", PrescribedPerformance(ENVELOPE_4_1, 0.2)),
    ("prescribed_performance_exponential", PrescribedPerformance(Exponential([0.8, 0.6], 0.002, 1.0), [0.5, 0.9])),
    ("unconstrained", Unconstrained()),
]

TRANSFORMATIONS_LIKE_OTHERS = ("prescribed_performance_exponential",)
"""The same class around another envelope: it runs in the long version."""


KALMAN_OF_ARM = Kalman.of_arm(np.diag([1.0, 0.1]), variance=1e-11, period=1e-3, torque_density=0.02)

ESTIMATORS: list[tuple[str, AbstractEstimator]] = [
    ("measured", Measured()),
    ("measured_per_joint", Measured([0.1, 1.0])),
    ("measured_ahead", Measured.critical(0.3, 1.0)),
    ("measured_with_trend", Measured([0.3, 0.5], [0.02, 0.1], 2.0)),
    ("filtered_difference", FilteredDifference(200.0)),
    ("filtered_difference_per_joint", FilteredDifference([100.0, 1000.0], [0.25, 1.0])),
    ("kalman", Kalman.steady(density=1.0, variance=1e-10 / 12, period=1e-3)),
    ("kalman_per_joint", Kalman.steady(density=[1.0, 1e3], variance=[1e-10, 1e-12], period=1e-3)),
    ("strong_tracking", StrongTracking(KALMAN_OF_ARM, [3e-6, 1e-5])),
    ("robust_differentiator", RobustDifferentiator(50.0)),
    ("robust_differentiator_per_joint", RobustDifferentiator([10.0, 1e4])),
]

ESTIMATORS_LIKE_OTHERS = ("measured", "measured_per_joint", "filtered_difference", "kalman", "robust_differentiator")
"""The same classes with other numbers: these run in the long version."""


REACHING: list[tuple[str, AbstractReaching]] = [
    ("fixed_time_4_1", FixedTimeReaching(0.1, 1.2, 0.05)),
    ("fixed_time_unit_vector", FixedTimeReaching([1.0, 0.5], 1.5)),
    ("fixed_time_matrix", FixedTimeReaching([[0.2, 0.1], [0.1, 0.4]], 1.2, 0.05)),
    ("two_power_4_2", TwoPowerReaching(5.0, 5.0, 2.5, 0.5)),
    ("two_power_layer", TwoPowerReaching([1.0, 2.0], 0.5, 1.5, 0.8, 0.1)),
    ("saturated_layer", SaturatedReaching([20.0, 10.0], [0.6, 0.8], 0.05)),
    ("saturated_sign", SaturatedReaching(5.0, 0.7, 0.0)),
]

REACHING_LIKE_OTHERS = ("fixed_time_4_1", "two_power_4_2", "saturated_layer")
"""The same classes with other numbers: these run in the long version."""

BOUNDS: list[tuple[str, AbstractBound]] = [
    ("uncertainty_4_1", UncertaintyBound(0.09, 0.2, 12.0, 2.2, 2.8, 1.0)),
    ("state", StateBound(12.0, 2.2, 2.8)),
    ("fixed", FixedBound(20.0)),
]


SURFACES: list[tuple[str, AbstractSurface]] = [
    ("smooth_fixed_time_4_1", SmoothFixedTime(k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01)),
    ("smooth_fixed_time_wide", SmoothFixedTime(k1=[0.5, 1.0], k2=[0.3, 0.2], p=[0.8, 0.3], q=1.7, delta=[1.0, 0.2])),
    ("linear_core_4_1", LinearCoreFixedTime(k1=1.5, k2=1.0, p=0.5, q=1.2, delta=0.01)),
    ("linear_core_wide", LinearCoreFixedTime(k1=[0.5, 1.0], k2=0.3, p=[0.8, 0.3], q=1.7, delta=[1.0, 0.2])),
    ("singularity_free_4_2", SingularityFree(c1=2.0, c2=2.0, alpha=0.7, beta=1.9, r=1.7, delta=0.3)),
    ("singularity_free_narrow", SingularityFree([1.0, 2.0], [0.5, 0.2], [0.7, 0.4], 1.2, [1.7, 2.5], [0.01, 2.0])),
    ("linear", Linear(rate=[5.0, 2.0])),
]

SURFACES_LIKE_OTHERS = ("smooth_fixed_time_4_1", "linear_core_4_1", "singularity_free_narrow")
"""The same classes with other numbers: these run in the long version."""


class Case(NamedTuple):
    """A scheme with its arm, motion and start."""

    controller: AbstractController
    robot: AbstractRobot
    trajectory: AbstractMotion
    start: State
    idle: int = 1
    """Number of gains without effect on the first torque: the surface's core, the memory's rate."""


def two_link(controller: AbstractController, idle: int = 1) -> Case:
    return Case(controller, TWO_LINK, MOTION_4_1, START_4_1, idle)


def scara(controller: AbstractController, idle: int = 1) -> Case:
    return Case(controller, SCARA, MOTION_4_2, START_4_2, idle)


FAR_LIMITS = TorqueLimits(1e6, 1e12)
"""Limits that are never reached, yet finite, so that difference quotients by them are finite."""


def sampled(law: AbstractController, **options: object) -> SampledData:
    return sampled_data(law, period=1e-3, limits=FAR_LIMITS, **options)


KALMAN = Kalman.steady(density=0.1, variance=1e-11, period=1e-3)

CONTROLLERS: list[tuple[str, Case]] = [
    ("cftsmppc_4_1", two_link(law_4_1())),
    ("cftsmppc_4_1_unit_vector", two_link(law_4_1(layer=0.0))),
    ("cftsmppc_4_2", scara(law_4_2())),
    ("cftsmppc_4_2_unit_vector", scara(law_4_2(layer=0.0))),
    ("ftsmppc_4_1", two_link(ftsmppc_4_1())),
    ("ftsmc_4_1", two_link(ftsmc_4_1())),
    ("sfsmc_4_2", scara(sfsmc_4_2())),
    ("sfsmc_4_2_inside_an_envelope", scara(sfsmc_4_2(transformation=AROUND_4_2, layer=0.05), idle=2)),
    ("nftsmc_4_2", scara(nftsmc_4_2())),
    ("anftsmc_4_2", scara(anftsmc_4_2(initial=[1.0, 0.5, 0.2], layer=0.01), idle=2)),
    ("slotine_li", two_link(slotine_li_4_1())),
    ("slotine_li_inside_an_envelope", two_link(slotine_li_4_1(AROUND_4_1, Linear(0.6)))),
    ("super_twisting", scara(super_twisting_4_2())),
    ("super_twisting_inside_an_envelope", scara(super_twisting_4_2(AROUND_4_2, Linear([0.5, 0.6, 0.7])))),
    ("sampled_cftsmppc_4_1", two_link(sampled(law_4_1(layer=0.0)), idle=11)),
    (
        "sampled_cftsmppc_4_1_layer_delay_and_recovery",
        two_link(sampled(law_4_1(), delay=1.5, dead_time=0.5, recovery=Recovery()), idle=14),
    ),
    ("sampled_cftsmppc_4_2_recovery", scara(sampled(law_4_2(layer=0.0), recovery=Recovery(), slopes=False), idle=14)),
    ("sampled_ftsmc_4_1", two_link(sampled(ftsmc_4_1(), estimator=KALMAN), idle=11)),
    ("sampled_sfsmc_4_2", scara(sampled(sfsmc_4_2(), delay=1.0), idle=11)),
    ("sampled_slotine_li", two_link(sampled(slotine_li_4_1(AROUND_4_1, Linear(0.6))), idle=11)),
    ("sampled_super_twisting", scara(sampled(super_twisting_4_2(AROUND_4_2, Linear([0.5, 0.6, 0.7]))), idle=11)),
    ("sampled_anftsmc", scara(sampled(anftsmc_4_2(initial=[1.0, 0.5, 0.2], layer=0.01), delay=1.0), idle=12)),
    ("sampled_computed_torque", two_link(sampled(computed_torque_4_1(), delay=1.5, dead_time=0.5), idle=11)),
    (
        "sampled_computed_torque_at_mid_period",
        two_link(sampled(computed_torque_4_1(horizon=0.02), delay=1.5, dead_time=0.5, midpoint=True), idle=11),
    ),
    ("computed_torque", two_link(computed_torque_4_1())),
    ("gravity_pd", two_link(gravity_pd_4_1())),
    # Without effect: as in gravity_pd, the limit, and the gain of an integral that is still zero.
    ("pid", two_link(pid_4_1(gravity=0.5, limit=1e4), idle=3)),
]

CONTROLLERS_LIKE_OTHERS = (
    "cftsmppc_4_2",
    "cftsmppc_4_2_unit_vector",
    "ftsmppc_4_1",
    "ftsmc_4_1",
    "sfsmc_4_2_inside_an_envelope",
    "slotine_li",
    "super_twisting_inside_an_envelope",
    "sampled_cftsmppc_4_1",
    "sampled_cftsmppc_4_2_recovery",
    "sampled_ftsmc_4_1",
    "sampled_sfsmc_4_2",
    "sampled_slotine_li",
    "sampled_super_twisting",
    "sampled_anftsmc",
)
"""The same laws with other parts, which have tests of their own: these run in the long version."""
