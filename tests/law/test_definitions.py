"""Refusals at construction name the field, the rule, the value and the joint."""

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import Command, State
from slidax.law import (
    AbstractController,
    ComputedTorque,
    JointLearning,
    Linear,
    LinearCoreFixedTime,
    Measured,
    SampledData,
    SingularityFree,
    StateBound,
    TwoPowerReaching,
    sampled_data,
)
from slidax.plant import TorqueLimits
from tests.paper_examples import SCARA, law_4_1
from tests.rivals import (
    anftsmc_4_2,
    computed_torque_4_1,
    gravity_pd_4_1,
    nftsmc_4_2,
    pid_4_1,
    sfsmc_4_2,
    slotine_li_4_1,
    super_twisting_4_2,
)

NAN = float("nan")


def test_a_state_of_text_is_refused():
    for text in ("a", ["a", "b"]):
        with pytest.raises(DefinitionError, match="a number or a list of numbers is needed"):
            State(text)


def linear_core(**changes):
    return LinearCoreFixedTime(**({"k1": 1.5, "k2": 1.0, "p": 0.5, "q": 1.2, "delta": 0.01} | changes))


def singularity_free(**changes):
    gains = {"c1": 2.0, "c2": 2.0, "alpha": 0.7, "beta": 1.9, "r": 1.7, "delta": 0.3}
    return SingularityFree(**(gains | changes))


def two_power(**changes):
    return TwoPowerReaching(**({"k1": 5.0, "k2": 5.0, "v1": 2.5, "v2": 0.5, "layer": 0.0} | changes))


def state_bound(**changes):
    return StateBound(**({"b0": 12.0, "b1": 2.2, "b2": 2.8} | changes))


WRONG = [
    (linear_core, "k1", [1.0, 0.0], "diagonal positive definite (eq. 40)", "got 0 for joint 2"),
    (linear_core, "k2", -1.0, "diagonal positive definite (eq. 40)", "got -1"),
    (linear_core, "p", 1.0, "must be in (0, 1) (eq. 78)", "got 1"),
    (linear_core, "q", 1.0, "must be > 1 (eq. 34)", "got 1"),
    (linear_core, "delta", 1.5, "must be in (0, 1] (eq. 78)", "got 1.5"),
    (singularity_free, "c1", 0.0, "diagonal positive definite ([24])", "got 0"),
    (singularity_free, "c2", [2.0, -2.0], "diagonal positive definite ([24])", "got -2 for joint 2"),
    (singularity_free, "alpha", 1.0, "must be in (0, 1) ([24])", "got 1"),
    (singularity_free, "beta", 1.0, "must be > 1 ([24])", "got 1"),
    (singularity_free, "r", 1.0, "must be > 1", "got 1"),
    (singularity_free, "delta", 0.0, "must be > 0 ([24])", "got 0"),
    (Linear, "rate", [5.0, 0.0], "must be > 0 1/s", "got 0 for joint 2"),
    (two_power, "k1", 0.0, "diagonal positive definite ([24])", "got 0"),
    (two_power, "k2", NAN, "diagonal positive definite ([24])", "got nan"),
    (two_power, "v1", 1.0, "must be > 1 ([24])", "got 1"),
    (two_power, "v2", 1.0, "must be in (0, 1) ([24])", "got 1"),
    (two_power, "layer", -0.1, "must be >= 0 (s0, eq. 51", "got -0.1"),
    (state_bound, "b0", -1.0, "must be >= 0 N m (eq. 19)", "got -1"),
    (state_bound, "b1", NAN, "must be >= 0 N m/rad (eq. 19)", "got nan"),
    (state_bound, "b2", -1.0, "must be >= 0 N m s²/rad² (eq. 19)", "got -1"),
    (nftsmc_4_2, "gamma2", 2.0, "must be in (1, 2)", "got 2"),
    (nftsmc_4_2, "gamma1", [2.0, 1.5, 2.0], "must be > `gamma2` = 1.6666666666666667 ([7])", "got 1.5 for joint 2"),
    (nftsmc_4_2, "reach", 0.0, "must be > 0 (M1, [7])", "got 0"),
    (nftsmc_4_2, "gain", -2.0, "must be > 0 1/s² (M2, [7])", "got -2"),
    (nftsmc_4_2, "layer", -1.0, "must be >= 0 (s0", "got -1"),
    (anftsmc_4_2, "alpha", 0.2, "the 0.2 of Table 2 is singular at e = 0", "got 0.2"),
    (anftsmc_4_2, "beta", 1.0, "must be in (1, 2)", "got 1"),
    (anftsmc_4_2, "k1", 0.0, "must be > 0 ([10])", "got 0"),
    (anftsmc_4_2, "k2", 0.0, "must be > 0 ([10])", "got 0"),
    (anftsmc_4_2, "gain", [250.0, 250.0, 0.0], "must be > 0 1/s² (k, [10])", "got 0 for joint 3"),
    (anftsmc_4_2, "margin", 0.0, "must be > 0 (η, [10])", "got 0"),
    (anftsmc_4_2, "adaptation", [0.01, -0.01, 0.01], "must be >= 0 (λ0, λ1, λ2, [10])", "got -0.01"),
    (anftsmc_4_2, "initial", [-1.0, 0.0, 0.0], "must be >= 0 (b̂0, b̂1, b̂2", "got -1"),
    (anftsmc_4_2, "layer", -0.1, "must be >= 0 (the boundary layer", "got -0.1"),
    (slotine_li_4_1, "damping", -1.0, "must be >= 0 (K_D", "got -1"),
    (slotine_li_4_1, "gain", [20.0, -1.0], "must be >= 0 (K;", "got -1 for joint 2"),
    (slotine_li_4_1, "layer", -0.1, "must be >= 0 (the boundary layer", "got -0.1"),
    (super_twisting_4_2, "k1", 0.0, "must be > 0 (Moreno and Osorio, 2012)", "got 0"),
    (super_twisting_4_2, "k2", [1.0, 1.0, 0.0], "must be > 0 (Moreno and Osorio, 2012)", "got 0 for joint 3"),
    (computed_torque_4_1, "kp", 0.0, "must be > 0 1/s²", "got 0"),
    (computed_torque_4_1, "kd", [20.0, NAN], "must be > 0 1/s", "got nan for joint 2"),
    (gravity_pd_4_1, "kp", -1.0, "the posture is stable", "got -1"),
    (gravity_pd_4_1, "kd", 0.0, "the posture is stable", "got 0"),
    (pid_4_1, "ki", [1.0, -1.0], "the joint is stable", "got -1 for joint 2"),
    (pid_4_1, "limit", 0.0, "must be > 0", "got 0"),
]


@pytest.mark.parametrize(
    ("make", "field", "value", "rule", "got"),
    WRONG,
    ids=[f"{make.__name__}-{field}={value}" for make, field, value, _, _ in WRONG],
)
def test_parameter_error_names_field_rule_value_and_joint(make, field, value, rule, got):
    with pytest.raises(DefinitionError) as refused:
        make(**{field: value})
    message = str(refused.value)
    assert f".{field}` " in message and rule in message and got in message


@pytest.mark.parametrize(
    ("make", "change", "name"),
    [
        (sfsmc_4_2, {"c1": [1.0, 1.0]}, "SingularityFree.c1"),
        (sfsmc_4_2, {"k1": [1.0, 1.0]}, "TwoPowerReaching.k1"),
        (nftsmc_4_2, {"gain": [1.0, 1.0]}, "NonsingularFastTerminal.gain"),
        (anftsmc_4_2, {"k2": [1.0, 1.0]}, "AdaptiveNonsingularFastTerminal.k2"),
        (slotine_li_4_1, {"gain": [1.0, 1.0, 1.0], "damping": 1.0}, "SlotineLi.gain"),
        (slotine_li_4_1, {"surface": Linear([1.0, 1.0, 1.0])}, "Linear.rate"),
        (super_twisting_4_2, {"k1": [1.0, 1.0]}, "SuperTwisting.k1"),
        (super_twisting_4_2, {"surface": Linear([1.0, 1.0])}, "Linear.rate"),
        (computed_torque_4_1, {"kp": [1.0, 1.0, 1.0]}, "ComputedTorque.kp"),
        (computed_torque_4_1, {"kd": np.eye(2)}, "ComputedTorque.kd"),
        (gravity_pd_4_1, {"kd": [1.0, 1.0, 1.0]}, "GravityCompensatedPD.kd"),
        (pid_4_1, {"limit": [1.0, 1.0, 1.0]}, "JointPID.limit"),
    ],
)
def test_gains_of_the_wrong_shape_are_refused(make, change, name):
    with pytest.raises(DefinitionError, match=rf"^`{name}` has shape \[.*\], but (TwoLink has 2|Scara has 3) joints"):
        make(**change)


@pytest.mark.parametrize(
    ("make", "change"),
    [(anftsmc_4_2, {"adaptation": [0.01, 0.01]}), (anftsmc_4_2, {"initial": 0.0}), (nftsmc_4_2, {"reach": [2.0] * 3})],
)
def test_gains_of_fixed_size_are_refused_in_other_sizes(make, change):
    with pytest.raises(DefinitionError, match=r"must be (3 numbers|one number); got shape"):
        make(**change)


def test_a_horizon_for_a_law_without_a_plan_is_refused():
    with pytest.raises(DefinitionError, match="`ComputedTorque` does not plan over a horizon; leave `horizon` out"):
        sampled_data(ComputedTorque(SCARA, 100.0, 20.0), period=1e-3, horizon=0.01)
    step = sampled_data(law_4_1(), period=1e-3).step
    with pytest.raises(DefinitionError, match=r"`SampledData.horizon` must be given for a law that plans"):
        SampledData(step, Measured(), TorqueLimits(), 1e-3)


def test_a_law_without_a_nominal_robot_has_no_sampled_data_form():
    class Blind(AbstractController):
        @property
        def joints(self):
            return 2

        def init(self, t, state, reference):
            return ()

        def __call__(self, t, state, reference_now, reference_next, memory):
            return Command(tau=jnp.zeros(2), memory=memory, signals={})

        def envelope(self, t, memory):
            return None

    with pytest.raises(DefinitionError, match="`Blind` has no `nominal` robot"):
        sampled_data(Blind(), period=1e-3)


def test_an_estimator_for_another_number_of_joints_is_refused():
    with pytest.raises(DefinitionError, match="`Measured` does not fit the 2 joints of TwoLink"):
        sampled_data(law_4_1(), period=1e-3, estimator=Measured([0.1, 0.2, 0.3]))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"period": -1e-3}, "`period` must be finite and > 0 s; got -0.001"),
        ({"period": NAN}, "`period` must be finite"),
        ({"period": 1e-3, "delay": NAN}, "`delay` must be finite and >= 0 periods"),
        ({"period": 1e-3, "delay_at_most": -1.0}, "`delay_at_most` must be finite"),
    ],
)
def test_an_invalid_time_of_a_sampled_data_law_is_refused_by_its_own_name(options, words):
    with pytest.raises(DefinitionError, match=words):
        sampled_data(law_4_1(), **options)


@pytest.mark.parametrize(
    ("name", "value"), [("torque", NAN), ("torque", 0.0), ("deviation", NAN), ("deviation", -1e-5)]
)
def test_joint_learning_refuses_an_invalid_rated_torque_or_encoder_noise(name, value):
    options = {"rotors": None, "torque": 80.0, "deviation": 1e-5, "period": 1e-3} | {name: value}
    with pytest.raises(DefinitionError, match="rated torque" if name == "torque" else "standard deviation"):
        JointLearning.of_arm(np.eye(2), **options)
