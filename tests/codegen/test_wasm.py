"""Programs as WebAssembly modules."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import codegen
from slidax.codegen.wasm import wasm_module
from slidax.codegen.wasm.binary import (
    MADD,
    MAGIC,
    bodies,
    decode_leb128,
    encode_leb128,
    find_multiply_adds,
    with_export,
)
from slidax.core.errors import DefinitionError


def example(x, y):
    return {"z": jnp.sin(x) * y + jnp.exp(y) * x + x**2.5}


PROGRAM = codegen.trace(example, jnp.ones(3), jnp.ones(3))


@pytest.mark.parametrize("value", [0, 1, 127, 128, 300, 2**32 - 1])
def test_leb128_integers_survive_encoding_and_decoding(value):
    assert decode_leb128(b"x" + encode_leb128(value), 1) == (value, 1 + len(encode_leb128(value)))


def test_a_module_exports_one_function_and_describes_its_arguments():
    module = wasm_module(PROGRAM)
    assert module.bytes[:8] == MAGIC
    assert b"\x03run\x00" in module.bytes
    assert module.inputs == (("f64", 3), ("f64", 3))
    assert module.outputs == (("f64", 3, False),)


def test_search_detects_each_multiply_add_and_nothing_else():
    module = wasm_module(PROGRAM)
    multiply_adds = {start + at for start, body in bodies(module.bytes) for at in find_multiply_adds(body)}
    # In this program, these bytes are nowhere else.
    assert len(multiply_adds) == module.bytes.count(MADD) > 20
    assert all(module.bytes[at : at + 3] == MADD for at in multiply_adds)
    assert module.others == ()
    # A constant with the bytes of a multiply-add does not count.
    body = bytes([0, 0x44, 0, *MADD, 0, 0, 0, 0, 0x1A, 0x0B])
    assert find_multiply_adds(body) == []


def test_same_program_gives_identical_wasm_bytes():
    again = codegen.trace(example, jnp.ones(3), jnp.ones(3))
    assert wasm_module(again).bytes == wasm_module(PROGRAM).bytes


def test_known_inputs_become_constants_of_the_module():
    module = wasm_module(PROGRAM, {1: np.zeros(3)})
    assert module.inputs == (("f64", 3),)
    assert len(module.bytes) < len(wasm_module(PROGRAM).bytes)
    assert module.digest != wasm_module(PROGRAM).digest


def test_bytes_that_are_no_module_are_refused():
    with pytest.raises(DefinitionError, match="not a WebAssembly object file"):
        with_export(b"\x7fELF....", "run")
