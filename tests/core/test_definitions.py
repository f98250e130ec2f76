"""Invalid parameters are refused at construction, with the field, the rule, its equation, the value and the joint."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import config

from slidax.arms import Scara, TwoLink
from slidax.core.errors import DefinitionError, count_noun, each_of, locate_errors, percent, span
from slidax.law import (
    Exponential,
    FiniteTime,
    FixedTime,
    FixedTimeReaching,
    PrescribedPerformance,
    SmoothFixedTime,
    UncertaintyBound,
)
from slidax.motions import ConstantPosture as Posture
from slidax.motions import ExponentialSum, MinimumJerk, Sinusoid
from slidax.plant import Constant, Friction, Harmonic, Scaled, Step
from slidax.studies.study import all_done
from tests.paper_examples import ENVELOPE_4_1, law_4_1

NAN = float("nan")


def maker(part, **defaults):
    """A function that makes the part with some of its parameters changed."""
    return lambda **changes: part(**defaults | changes)


fixed_time = maker(FixedTime, initial=[0.8, 0.6], final=0.002, deadline=[5.0, 6.0], exponent=2.01)
surface = maker(SmoothFixedTime, k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01)
bound = maker(UncertaintyBound, inverse_inertia_min=0.09, inverse_inertia_max=0.2, b0=12.0, b1=2.2, b2=2.8, margin=1.0)
reaching = maker(FixedTimeReaching, gain=0.1, exponent=1.2, layer=0.05)
two_link = maker(TwoLink, lengths=[1.0, 0.8], masses=[0.5, 1.5], inertias=[5.0, 5.0])
scara = maker(Scara, lengths=[0.3, 0.4], masses=[2.0, 2.0, 1.0])
exponential = maker(Exponential, initial=1.0, final=0.1, rate=1.0)
finite_time = maker(FiniteTime, initial=1.0, final=0.1, rate=1.0, exponent=0.6)
prescribed = maker(PrescribedPerformance, performance=ENVELOPE_4_1)
friction = maker(Friction, coulomb=0.3)
harmonic = maker(Harmonic, amplitude=[1.0], frequency=1.0)
sinusoid = maker(Sinusoid, offset=[0.0, 0.0], amplitude=1.0, frequency=1.0)
exponentials = maker(ExponentialSum, offset=[0.0], amplitudes=[[1.0]])


SMOOTH = "must be > 2, so that the second derivative is continuous"
DEFINITE = "symmetric positive definite (K0, eq. 43)"
WRONG = [
    (fixed_time, "deadline", [5.0, 0.0], "must be > 0 s (eq. 20)", "got 0 for joint 2"),
    (fixed_time, "deadline", -1.0, "must be > 0 s (eq. 20)", "got -1"),
    (fixed_time, "exponent", [2.01, 1.5], SMOOTH, "got 1.5 for joint 2"),
    (fixed_time, "exponent", 2.0, "(eq. 20)", "got 2"),
    (fixed_time, "final", [0.002, 0.0], "must be > 0 (Definition 4, eq. 20)", "got 0 for joint 2"),
    (fixed_time, "final", -0.1, "must be > 0", "got -0.1"),
    (fixed_time, "initial", [0.8, 0.001], "must be > `final`", "got 0.001 for joint 2"),
    (fixed_time, "initial", 0.002, "(eq. 20)", "got 0.002"),
    (fixed_time, "initial", [NAN, 0.6], "must be", "got nan for joint 1"),
    (fixed_time, "deadline", NAN, "must be > 0 s", "got nan"),
    (exponential, "rate", 0.0, "Definition 4", "got 0"),
    (finite_time, "exponent", [0.6, 0.5], "must be in (1/2, 1)", "got 0.5 for joint 2"),
    (prescribed, "overshoot", 0.0, "must be in (0, 1) (eq. 13)", "got 0"),
    (prescribed, "overshoot", [0.2, 1.0], "(eq. 13)", "got 1 for joint 2"),
    (surface, "p", 0.0, "must be in (0, 1) (eq. 29)", "got 0"),
    (surface, "p", [0.5, 1.0], "(eq. 29)", "got 1 for joint 2"),
    (surface, "q", [1.0, 1.2], "must be > 1 (eq. 34)", "got 1 for joint 1"),
    (surface, "delta", 0.0, "must be in (0, 1] (eq. 29)", "got 0"),
    (surface, "delta", [0.01, 1.5], "(eq. 29)", "got 1.5 for joint 2"),
    (surface, "k1", [0.2, 0.0], "diagonal positive definite (eq. 40)", "got 0 for joint 2"),
    (surface, "k2", -0.6, "diagonal positive definite (eq. 40)", "got -0.6"),
    (surface, "k1", NAN, "must be > 0", "got nan"),
    (reaching, "exponent", 1.0, "must be > 1 (r, eq. 43)", "got 1"),
    (reaching, "gain", [0.1, 0.0], "symmetric positive definite (K0, eq. 43)", "got 0 for joint 2"),
    (reaching, "gain", [[1.0, 2.0], [2.0, 1.0]], DEFINITE, "[[1.0, 2.0], [2.0, 1.0]]"),
    (reaching, "gain", [[1.0, 0.5], [0.0, 1.0]], "symmetric positive definite", "[[1.0, 0.5], [0.0, 1.0]]"),
    (reaching, "gain", [[1.0, NAN], [NAN, 1.0]], "symmetric positive definite", "nan"),
    (reaching, "layer", -0.05, "must be >= 0 (s0, eq. 51", "got -0.05"),
    (bound, "inverse_inertia_min", 0.0, "must be > 0 1/(kg m²) (m1, eq. 47)", "got 0"),
    (bound, "inverse_inertia_max", 0.05, "(m2, eq. 47)", "got 0.05"),
    (bound, "margin", 0.0, "must be > 0 N m (k, eq. 45)", "got 0"),
    (bound, "b0", -1.0, "must be >= 0 N m (eq. 19)", "got -1"),
    (bound, "b1", -1.0, "must be >= 0 N m/rad (eq. 19)", "got -1"),
    (bound, "b2", NAN, "must be >= 0 N m s²/rad² (eq. 19)", "got nan"),
    (two_link, "masses", [0.5, 0.0], "must be > 0 kg", "got 0 for"),
    (two_link, "lengths", [-1.0, 0.8], "must be > 0 m", "got -1 for"),
    (two_link, "inertias", [5.0, -5.0], "must be >= 0 kg m²", "got -5 for"),
    (scara, "masses", [2.0, -2.0, 1.0], "must be > 0 kg", "got -2 for"),
    (scara, "lengths", [0.3, NAN], "must be > 0 m", "got nan for"),
    (friction, "coulomb", [0.3, -0.1], "must be >= 0", "got -0.1 for joint 2"),
    (friction, "smoothing", 0.0, "must be > 0", "got 0"),
    (harmonic, "frequency", NAN, "must be finite", "got nan"),
    (Constant, "value", [1.0, NAN], "must be finite", "got nan for joint 2"),
    (Posture, "value", [NAN, 1.0], "must be finite", "got nan for joint 1"),
    (maker(Step, value=[1.0], start=2.0), "end", 1.0, "must be > `start` = 2.0 s", "got 1"),
    (maker(Scaled, disturbance=Constant([1.0])), "factor", NAN, "must be finite", "got nan"),
    (sinusoid, "amplitude", [1.0, NAN], "must be finite", "got nan for joint 2"),
    (exponentials, "rates", [0.0], "must be > 0", "got 0"),
]


@pytest.mark.parametrize(
    ("make", "field", "value", "rule", "got"), WRONG, ids=[f"{field}={value}" for _, field, value, _, _ in WRONG]
)
def test_an_invalid_parameter_is_refused_with_its_field_rule_value_and_joint(make, field, value, rule, got):
    with pytest.raises(DefinitionError) as refused:
        make(**{field: value})
    message = str(refused.value)
    assert f".{field}` " in message
    assert rule in message and got in message


@pytest.mark.parametrize(
    ("make", "values"),
    [
        *((make, {}) for make in (fixed_time, surface, bound, reaching, two_link, scara)),
        (surface, {"delta": 1.0}),
        (reaching, {"layer": 0.0}),
        (bound, {"inverse_inertia_max": 0.09, "b2": 0.0}),
    ],
)
def test_valid_parameters_including_the_closed_ends_of_ranges_are_accepted(make, values):
    assert jax.tree.leaves(make(**values))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"k1": [0.2, 0.2, 0.2]}, "k1"),
        ({"overshoot": [0.2, 0.2, 0.2]}, "overshoot"),
        ({"gain": [0.1, 0.1, 0.1]}, "gain"),
        ({"gain": np.eye(3)}, "gain"),
        ({"performance": FixedTime(1.0, 0.1, [1.0, 2.0, 3.0], 2.1)}, "deadline"),
    ],
)
def test_a_parameter_with_the_wrong_number_of_joints_is_refused(change, name):
    with pytest.raises(DefinitionError, match=f"{name}.*TwoLink has 2 joints"):
        law_4_1(**change)


def test_a_parameter_that_is_no_number_is_refused():
    with pytest.raises(DefinitionError, match="a number or a list of numbers is needed; got 'wide'"):
        fixed_time(initial="wide")


@pytest.fixture
def unchecked_shapes():
    """Arguments whose shapes no type checker checks, as for a user."""
    config.update("jaxtyping_disable", True)
    yield
    config.update("jaxtyping_disable", False)


@pytest.mark.parametrize(
    ("times", "waypoints", "message"),
    [
        ([0.0], [[0.0]], "two or more increasing times"),
        ([1.0, 0.0], [[0.0], [1.0]], "two or more increasing times"),
        ([0.0, NAN], [[0.0], [1.0]], "two or more increasing times"),
        ([0.0, 1.0], [[0.0]], "two or more rows with one position per joint; got shape"),
        ([0.0, 1.0], [0.0, 1.0], "two or more rows with one position per joint"),
        ([0.0, 1.0], [[0.0], [NAN]], "must be finite; waypoint 2 is not, for joint 1"),
        ([0.0, 1.0], [[0.0], [-1e308]], r"must be at most 1e\+09 in size; got -1e\+308 in waypoint 2 for joint 1"),
        ([0.0, 1e-320, 1.0], [[0.0], [1.0], [2.0]], "times` lie too close together"),
    ],
)
def test_impossible_waypoints_are_refused(times, waypoints, message):
    with pytest.raises(DefinitionError, match=message):
        MinimumJerk.through(times, waypoints)


@pytest.mark.parametrize("amplitudes", [[[1.0, 1.0]], [[1.0], [1.0]], [1.0, 1.0]])
def test_an_exponential_sum_whose_amplitudes_do_not_fit_its_rates_and_joints_is_refused(amplitudes, unchecked_shapes):
    with pytest.raises(DefinitionError, match="one row per rate and one column per joint; got shape"):
        ExponentialSum([0.0, 0.0], amplitudes, [1.0, 2.0])


def test_a_definition_error_names_the_block_of_the_scenario():
    with pytest.raises(DefinitionError, match=r"^scheme\.performance: `FixedTime\.exponent`") as refused:  # noqa: SIM117
        with locate_errors("scheme"), locate_errors("performance"):
            fixed_time(exponent=1.0)
    assert refused.value.where == "scheme.performance"


def test_traced_values_are_not_checked_inside_jit():
    assert float(jax.jit(lambda s: fixed_time(exponent=s).radius(jnp.asarray(1.0))[0])(1.5)) > 0


@pytest.mark.parametrize(
    ("share", "expected"),
    [
        (0.0, "0 %"),
        (0.00042, "0.042 %"),
        (0.3, "30 %"),
        (0.613, "61 %"),
        # Below 100 %, so neither "100 %" nor "1e+02 %".
        (0.9997, "99.97 %"),
        (1.003, "100.3 %"),
        (1.0, "100 %"),
        (63.38, "6338 %"),
        (-0.2, "-20 %"),
        (np.inf, "inf %"),
    ],
)
def test_percentages_print_without_exponent_and_show_a_small_gap_to_100(share, expected):
    assert percent(share) == expected


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        *((span(0.128, high), expected) for high, expected in ((0.132, "0.13"), (0.27, "0.13 to 0.27"))),
        *((count_noun(n, "law"), expected) for n, expected in ((1, "1 law"), (0, "0 laws"))),
        *((count_noun(n, "entry", "entries"), expected) for n, expected in ((1, "1 entry"), (2, "2 entries"))),
        *((each_of(n, "joint"), expected) for n, expected in ((1, "the joint"), (3, "each of the 3 joints"))),
        *((all_done(n), expected) for n, expected in ((1, "the run is done"), (2, "all 2 runs are done"))),
    ],
)
def test_messages_print_singular_plural_and_intervals_correctly(words, expected):
    assert words == expected
