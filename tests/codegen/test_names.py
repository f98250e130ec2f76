"""Names and comments of generated code come from the source, in ASCII."""

import jax
import jax.numpy as jnp
import pytest

from slidax import scenarios
from slidax.codegen import trace
from slidax.codegen.naming import Names, identifier, to_ascii
from slidax.codegen.naming.names import index_suffix
from slidax.core import barrier, power
from slidax.core.types import Reference

X = jnp.array([0.3, 0.7])


def names_in(function, *args):
    """Return the names of a function's values: the firm names and all names."""
    program = trace(function, *args, names=["abcdefgh"[k] for k in range(len(args))])
    named = map(Names(program).of, [value for value in program.walk() if value.op not in ("input", "const")])
    texts = [(name.text, name.firm) for name in named if name]
    return {text for text, firm in texts if firm}, {text for text, _ in texts}


def halves(x):
    """`x/2`, eq. (7), and its sine."""
    half = x * 0.5
    return half, jnp.sin(half)


def by_joint(x):
    error = x - jnp.array([1.0, 2.0])
    return jnp.exp(error)


def whole_expression(x):
    long = x[0] * 2.0 + jnp.sin(x[0] * 3.0)
    return long * long


def of_a_tuple(x):
    half, sine = halves(x[0])
    return half + sine


def behind_a_barrier(x):
    cosine, sine = barrier((jnp.cos(x[0]), jnp.sin(x[0])))
    return cosine * sine


def entries_of_a_list(x):
    m = jnp.array([[x[0] * 2.0, x[1] + 1.0], [x[1] - 3.0, x[0] * x[1]]])
    return m @ x


def by_keyword(x):
    return Reference(q=x * 2.0, dq=jnp.sin(x), ddq=x)


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (by_joint, {"error_1", "error_2"}),
        (whole_expression, {"long_"}),
        (of_a_tuple, {"half", "sine"}),
        (behind_a_barrier, {"cosine", "sine"}),
        (entries_of_a_list, {"m_11", "m_12", "m_21", "m_22"}),
        (by_keyword, {"q_1", "q_2", "dq_1", "dq_2"}),
    ],
)
def test_value_has_the_name_that_the_source_gives_it(law, expected):
    firm, _ = names_in(law, X)
    assert firm == expected


def test_variable_name_belongs_to_the_result_of_a_call_only():
    def law(x):
        rest = jnp.mod(x, 0.3)
        return rest * rest

    program = trace(law, X[0])
    names = Names(program)
    (product,) = program.outputs[0].values
    assert product.args[0] is product.args[1]
    assert names.of(product.args[0]).text == "rest"
    assert [name.text for name in map(names.of, program.walk()) if name].count("rest") == 1


def test_a_derivative_does_not_get_the_name_of_its_function():
    def position(t):
        swing = jnp.sin(t * 2.0)
        return swing

    def law(t):
        return jax.jvp(position, (t,), (jnp.ones(()),))

    program = trace(law, X[0])
    names = Names(program)
    swing = [value.op for value in program.walk() if names.of(value) and names.of(value).text == "swing"]
    assert swing == ["sin"]


def test_unnamed_expressions_are_named_after_their_operands():
    def law(t):
        rate = jax.grad(lambda t: jnp.sin(t) * t)(t)
        return 1.0 / rate

    firm, all_of_them = names_in(law, X[0])
    assert "rate" in all_of_them - firm


def test_chosen_name_of_a_value_is_used():
    program = trace(lambda x: x * 2.0 + 1.0, X[0])
    value = program.outputs[0].values[0]
    assert Names(program, {value: "tau"}).of(value).text == "tau"


def test_inputs_have_the_shortest_distinct_names():
    program = trace(lambda a, b: a["q"] * b["q"] * b["k"], {"q": X}, {"q": X, "k": X[0]}, names=["state", "gains"])
    names = Names(program)
    inputs = [names.of(value).text for value in program.body.values if value.op == "input"]
    assert inputs == ["q_1", "q_2", "k", "gains_q_1", "gains_q_2"]


def test_a_comment_has_the_formula_of_the_innermost_function():
    program = trace(lambda x: halves(x)[1] * 2.0, X[0])
    names = Names(program)
    about = [names.about(value) for value in program.walk() if value.op in ("mul", "sin")]
    assert "halves: x/2, eq. (7), and its sine" in about


def test_a_method_without_a_formula_gets_the_comment_of_its_class():
    scenario = scenarios.load("example-4.1")
    program = trace(scenario.controller.transformation.performance.radius, jnp.ones(()))
    names = Names(program)
    (about,) = {names.about(value) for value in program.walk() if value.op == "pow"}
    assert about.startswith("FixedTime: rho(t) = (rho0 - rho_inf)(1 - t/T)^sigma + rho_inf")
    assert "eq. (20)" in about


def test_program_without_source_locations_names_only_its_inputs():
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
    assert to_ascii(text) == expected


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
def test_identifiers_avoid_reserved_words_and_library_names_of_c(name, expected):
    assert identifier(name) == expected


@pytest.mark.parametrize(
    ("element", "shape", "expected"),
    [(0, (), ""), (1, (2,), "_2"), (0, (1,), "_1"), (5, (2, 3), "_23"), (1, (3, 1), "_2"), (11, (12,), "_12")],
)
def test_element_suffixes_count_from_one(element, shape, expected):
    assert index_suffix(element, shape) == expected
