"""Names and comments in generated code: those of the source, in ASCII."""

import jax
import jax.numpy as jnp
import pytest

from slidax import scenarios
from slidax.codegen import trace
from slidax.codegen.naming import Names, identifier, plain
from slidax.codegen.naming.names import index_suffix
from slidax.core import barrier, power
from slidax.core.types import Reference

X = jnp.array([0.3, 0.7])


def names_in(function, *args):
    """The names that values of a function get, firm ones and all."""
    program = trace(function, *args, names=["abcdefgh"[k] for k in range(len(args))])
    names = Names(program)
    found = [names.of(value) for value in program.walk() if value.op not in ("input", "const")]
    return {name.text for name in found if name and name.firm}, {name.text for name in found if name}


def halves(x):
    """`x/2`, eq. (7), and its sine."""
    half = x * 0.5
    return half, jnp.sin(half)


def test_a_value_has_the_name_of_its_variable_and_its_joint():
    def law(x):
        error = x - jnp.array([1.0, 2.0])
        return jnp.exp(error)

    firm, _ = names_in(law, X)
    assert firm == {"error_1", "error_2"}


def test_only_the_whole_of_an_expression_has_the_name():
    def law(x):
        long = x * 2.0 + jnp.sin(x * 3.0)
        return long * long

    firm, _ = names_in(law, X[0])
    assert firm == {"long_"}


def test_of_all_that_a_call_makes_its_result_has_the_name():
    def law(x):
        rest = jnp.mod(x, 0.3)
        return rest * rest

    program = trace(law, X[0])
    names = Names(program)
    (product,) = program.outputs[0].values
    assert product.args[0] is product.args[1]
    assert names.of(product.args[0]).text == "rest"
    assert [name.text for name in map(names.of, program.walk()) if name].count("rest") == 1


def test_a_tuple_names_each_of_its_values():
    def law(x):
        half, sine = halves(x)
        return half + sine

    firm, _ = names_in(law, X[0])
    assert firm == {"half", "sine"}


def test_what_only_passes_through_is_named_behind_it():
    def law(x):
        cosine, sine = barrier((jnp.cos(x), jnp.sin(x)))
        return cosine * sine

    firm, _ = names_in(law, X[0])
    assert firm == {"cosine", "sine"}


def test_a_list_that_becomes_an_array_names_its_entries():
    def law(x):
        m = jnp.array([[x[0] * 2.0, x[1] + 1.0], [x[1] - 3.0, x[0] * x[1]]])
        return m @ x

    firm, _ = names_in(law, X)
    assert {"m_11", "m_12", "m_21", "m_22"} <= firm


def test_a_keyword_of_a_class_is_a_name_too():
    def law(x):
        return Reference(q=x * 2.0, dq=jnp.sin(x), ddq=x)

    firm, _ = names_in(law, X)
    assert firm == {"q_1", "q_2", "dq_1", "dq_2"}


def test_a_derivative_does_not_take_the_name_of_what_it_is_of():
    def position(t):
        swing = jnp.sin(t * 2.0)
        return swing

    def law(t):
        return jax.jvp(position, (t,), (jnp.ones(()),))

    program = trace(law, X[0])
    names = Names(program)
    swing = [value.op for value in program.walk() if names.of(value) and names.of(value).text == "swing"]
    assert swing == ["sin"]


def test_the_operands_of_an_expression_lend_their_names():
    def law(t):
        rate = jax.grad(lambda t: jnp.sin(t) * t)(t)
        return 1.0 / rate

    firm, all_of_them = names_in(law, X[0])
    assert "rate" in all_of_them - firm


def test_chosen_names_come_first():
    program = trace(lambda x: x * 2.0 + 1.0, X[0])
    value = program.outputs[0].values[0]
    assert Names(program, {value: "tau"}).of(value).text == "tau"


def test_inputs_are_told_apart_by_as_little_as_it_takes():
    program = trace(lambda a, b: a["q"] * b["q"] * b["k"], {"q": X}, {"q": X, "k": X[0]}, names=["state", "gains"])
    names = Names(program)
    found = [names.of(value).text for value in program.body.values if value.op == "input"]
    assert found == ["q_1", "q_2", "k", "gains_q_1", "gains_q_2"]


def test_a_comment_tells_the_formula_of_the_innermost_function():
    program = trace(lambda x: halves(x)[1] * 2.0, X[0])
    names = Names(program)
    about = [names.about(value) for value in program.walk() if value.op in ("mul", "sin")]
    assert "halves: x/2, eq. (7), and its sine" in about


def test_a_method_without_a_formula_is_told_by_its_class():
    scenario = scenarios.load("example-4.1")
    program = trace(scenario.controller.transformation.performance.radius, jnp.ones(()))
    names = Names(program)
    (about,) = {names.about(value) for value in program.walk() if value.op == "pow"}
    assert about.startswith("FixedTime: rho(t) = (rho0 - rho_inf)(1 - t/T)^sigma + rho_inf")
    assert "eq. (20)" in about


def test_a_program_without_origins_has_names_for_its_inputs_only():
    program = trace(lambda x: power(x, x) + x, X[0], names=["x"], named=False)
    names = Names(program)
    assert {names.of(value).text for value in program.walk() if names.of(value)} == {"x"}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("M0 (q̈_d - Ȧ e - A ė)", "M0 (ddq_d - dA e - A de)"),
        ("ρ∞ + (ρ0 - ρ∞)(1 - t/T)^σ", "rho_inf + (rho0 - rho_inf)(1 - t/T)^sigma"),
        ("s = B⁻¹ε2", "s = B^-1 eps2"),
        ("ρ̈ρ - ρ̇²", "ddrho rho - drho^2"),
        ("b̄, K1 Ŝ^p, ‖s‖ ≤ 1/s²", "b_bar, K1 S_hat^p, |s| <= 1/s^2"),
        ("δ ϑ λ Δ Λ", "delta theta lambda Delta Lambda"),
        ("语", "?"),
    ],
)
def test_formulas_are_written_in_ascii(text, expected):
    assert plain(text) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tau", "tau"),
        ("τ", "tau"),
        ("gamma", "gamma_"),
        ("y0", "y0_"),
        ("sinf", "sinf_"),
        ("double", "double_"),
        ("class", "class_"),
        ("2nd", "v2nd"),
        ("a.b[0]", "a_b_0"),
        ("_inner", "inner"),
        ("larger", "larger_"),
    ],
)
def test_a_name_means_nothing_to_a_compiler_yet(name, expected):
    assert identifier(name) == expected


@pytest.mark.parametrize(
    ("element", "shape", "expected"),
    [(0, (), ""), (1, (2,), "_2"), (0, (1,), "_1"), (5, (2, 3), "_23"), (1, (3, 1), "_2"), (11, (12,), "_12")],
)
def test_joints_are_counted_from_one(element, shape, expected):
    assert index_suffix(element, shape) == expected
