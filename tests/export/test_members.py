import equinox as eqx
import jax.numpy as jnp
import pytest
from jaxtyping import Array

from slidax.codegen.c import Dialect
from slidax.core.errors import DefinitionError
from slidax.export.c_source import with_unused_arguments
from slidax.export.c_structures import comment, declarations, members, shorten
from slidax.export.programs import float_constant


class Inner(eqx.Module):
    """A part, eq. (7). And more.

    - `gain`, `rate`: K and its rate, one number or [n], N m, > 0; in
      two lines.
    - `flag`: whether `ė` counts.
    """

    gain: Array
    rate: Array
    flag: Array


class Outer(eqx.Module):
    """A whole.

    - `inner`: the part.
    - `pair`: two of them.
    """

    inner: Inner
    pair: tuple[Array, Array]


TREE = Outer(Inner(jnp.array([1.5, 2.0]), jnp.asarray(jnp.inf), jnp.asarray(True)), (jnp.zeros(()), jnp.ones(())))


def test_a_c_structure_member_has_its_path_as_name_and_its_meaning_and_part():
    gain, rate, flag, first, second = members(TREE, values=True)
    assert [m.name for m in (gain, rate, flag, first, second)] == [
        "inner_gain", "inner_rate", "inner_flag", "pair_0", "pair_1",
    ]  # fmt: skip
    assert gain.meaning == rate.meaning == "K and its rate, N m, > 0; in two lines"
    assert flag.meaning == "whether de counts" and gain.part == "Inner: A part, eq. (7)"
    assert (gain.type, flag.type, gain.brackets, rate.brackets) == ("f64", "b1", "[2]", "")
    assert first.meaning == "two of them"


def test_prefixes_to_strip_are_left_out_of_member_names():
    assert members(TREE, strip=("inner",))[0].name == "gain"


def test_two_members_with_the_same_name_are_refused():
    twice = {"a": {"b": jnp.zeros(())}, "a_b": jnp.zeros(())}
    with pytest.raises(DefinitionError, match="`a_b`"):
        members(twice)


def test_c_declarations_are_grouped_by_part_with_aligned_comments():
    lines = declarations(members(TREE.inner, values=True), Dialect())
    assert lines[0] == "/* Inner: A part, eq. (7) */"
    assert lines[1] == "double gain[2]; /* 1.5, 2.0: K and its rate, N m, > 0; in two lines */"
    assert lines[2] == "double rate;    /* none: K and its rate, N m, > 0; in two lines */"
    assert lines[3] == "bool flag;      /* true: whether de counts */"


def test_a_c_comment_is_ascii_and_cannot_end_early():
    assert comment("`τ = M q̈`, ρ∞ */ and /* x²") == "tau = M ddq, rho_inf * / and / * x^2"


def test_a_long_meaning_is_shortened_at_a_comma():
    assert shorten("one of eq. (3), another, and a third. More.", 40) == "one of eq. (3), another, and a third"
    assert shorten("one of eq. (3), another, and a third", 25) == "one of eq. (3), another"


@pytest.mark.parametrize(
    ("double", "single"),
    [
        *((1e-12, 16 * 2.0**-23), (4e-16, 4 * 2.0**-23), (1.6e-15, 1.6e-15 * 2.0**29), (1.0 - 1e-9, 1.0 - 2.0**-21)),
        (-1e-12, -16 * 2.0**-23),
    ],
)
def test_tolerances_and_constants_near_1_are_adapted_to_single_precision(double, single):
    assert float_constant(double) == pytest.approx(single, rel=1e-12)


@pytest.mark.parametrize("number", [0.0, 1.0, -1.0, 0.5, 1e-30, 1e-150, 1e-6, 9.8, 1e9])
def test_other_constants_are_unchanged_in_single_precision(number):
    assert float_constant(number) == number


def test_an_argument_is_unused_unless_its_whole_name_occurs_in_the_code():
    not_read = ["    at[0] = dot(left, q[0]) + then->t;  /* t is the time */"]
    assert with_unused_arguments(not_read, ("t", "q")) == ["    (void)t;", *not_read]
    read = ["    x = 2.0 * t;", "    y = -q[1];"]
    assert with_unused_arguments(read, ("t", "q")) == read
