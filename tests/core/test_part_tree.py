"""A part prints its parameters with values and units, and then its inner parts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from slidax import scenarios
from slidax.core import AbstractPart, PerJoint, Scalar, Vector, parameter, piece
from tests.paper_examples import law_4_1


class Inner(AbstractPart):
    """A part."""

    gain: PerJoint = parameter("a gain", "rad/s", "> 0")


class Outer(AbstractPart):
    """A part with parts."""

    inner: Inner = piece("a part")
    others: tuple[Inner, ...] = piece("more of them")
    many: Vector = parameter("too many to read")
    left_out: Scalar | None = parameter("not given", default=None)
    how: str = piece("a choice", default="so", static=True)


PARTS = Outer(Inner([1.0, 0.25]), (Inner(2.0), Inner(1e-9)), jnp.zeros(40))


def test_a_part_prints_its_parameters_with_units_and_a_line_per_inner_part():
    assert repr(PARTS).splitlines() == [
        "Outer(many = [40], how = 'so')",
        "  inner: Inner(gain = [1, 0.25] rad/s)",
        "  others[0]: Inner(gain = 2 rad/s)",
        "  others[1]: Inner(gain = 1e-09 rad/s)",
    ]


def test_a_law_prints_its_gains_and_no_arrays():
    text = repr(eqx.tree_at(lambda law: law.surface.k1, law_4_1(), jnp.asarray(0.1234)))
    assert "  surface: SmoothFixedTime(k1 = 0.1234 " in text
    assert "f64" not in text and "Array" not in text
    assert all(len(line) <= 110 for line in text.splitlines())


@pytest.mark.parametrize("name", scenarios.names())
def test_parts_of_every_built_in_scenario_print_without_object_addresses(name):
    loop = scenarios.load(name)
    for part in (loop.controller, loop.plant, loop.trajectory, loop.stepping):
        assert repr(part).startswith(type(part).__name__)
        assert "object at 0x" not in repr(part)


def test_a_part_with_traced_or_missing_values_can_be_printed():
    texts = []
    jax.jit(lambda part: texts.append(repr(part)))(PARTS)
    assert "  inner: Inner(gain = traced [2] rad/s)" in texts[0]
    assert repr(jax.tree.map(lambda _: None, PARTS)).startswith("Outer(how = 'so')\n  inner: Inner\n")
    assert "ShapeDtypeStruct" in repr(eqx.filter_eval_shape(lambda: PARTS))
