"""Every scheme, with the arm, motion and start that it is tried on: one line enrols a new one in the laws' battery."""

from typing import NamedTuple

from slidax.arms import AbstractRobot
from slidax.core.types import State
from slidax.law import AbstractController, Kalman, Linear, Recovery, SampledData, sampled_data
from slidax.motions import AbstractMotion
from slidax.plant import TorqueLimits
from tests.paper_examples import (
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


class Case(NamedTuple):
    """A scheme at work."""

    controller: AbstractController
    robot: AbstractRobot
    trajectory: AbstractMotion
    start: State
    idle: int = 1
    """How many of its gains have no part in the first torque: those of the surface's core, and of the memory's rate."""


def two_link(controller: AbstractController, idle: int = 1) -> Case:
    return Case(controller, TWO_LINK, MOTION_4_1, START_4_1, idle)


def scara(controller: AbstractController, idle: int = 1) -> Case:
    return Case(controller, SCARA, MOTION_4_2, START_4_2, idle)


FAR_LIMITS = TorqueLimits(1e6, 1e12)
"""Limits that are never met, and finite, so that a difference quotient by them is."""


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
        two_link(sampled(law_4_1(), delay=1.5, dead_time=0.5, recovery=Recovery()), idle=13),
    ),
    ("sampled_cftsmppc_4_2_recovery", scara(sampled(law_4_2(layer=0.0), recovery=Recovery(), slopes=False), idle=13)),
    ("sampled_ftsmc_4_1", two_link(sampled(ftsmc_4_1(), estimator=KALMAN), idle=11)),
    ("sampled_sfsmc_4_2", scara(sampled(sfsmc_4_2(), delay=1.0), idle=11)),
    ("sampled_slotine_li", two_link(sampled(slotine_li_4_1(AROUND_4_1, Linear(0.6))), idle=11)),
    ("sampled_super_twisting", scara(sampled(super_twisting_4_2(AROUND_4_2, Linear([0.5, 0.6, 0.7]))), idle=11)),
    ("sampled_anftsmc", scara(sampled(anftsmc_4_2(initial=[1.0, 0.5, 0.2], layer=0.01), delay=1.0), idle=11)),
    ("sampled_computed_torque", two_link(sampled(computed_torque_4_1(), delay=1.5, dead_time=0.5), idle=11)),
    ("computed_torque", two_link(computed_torque_4_1())),
    ("gravity_pd", two_link(gravity_pd_4_1())),
    # Idle as in gravity_pd, and the limit, and the gain of an integral that is still zero.
    ("pid", two_link(pid_4_1(gravity=0.5, limit=1e4), idle=3)),
]

LIKE_OTHERS = (
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
"""The same laws with other parts, which are members of their own rooms: these run in the long version."""

RECOVERIES: list[tuple[str, Recovery]] = [("recovery", Recovery())]
