"""The CUDA kernel: it compiles with nvcc, and its results on the CPU (with a C++ compiler) and on a GPU."""

import shutil
import subprocess

import numpy as np
import pytest

from slidax import DefinitionError
from slidax.codegen import cuda
from slidax.codegen.builder import Builder
from slidax.codegen.cuda import pack_inputs

from .card_on_the_processor import CardOnTheProcessor, needs_gxx
from .random_programs import RandomProgram, random_arrays

RUNS, STEPS = 5, 40


def pendulum():
    """A damped pendulum by Euler's rule, with a log of every fourth sample and the final state."""
    b = Builder()
    start = b.input("state.start", "f64", (2,), varying=True)
    damping = b.input("damping", "f64", ())[()]
    steps, every = (b.input(name, "i64", ())[()] for name in ("steps", "every"))
    log = b.logged("log", "f64", (2,))
    zero, unit = b.constant(0, "i64"), b.constant(1, "i64")
    h = b.constant(0.01, "f64")

    def turn(carried):
        count, row, q, dq = carried
        due = b.apply("eq", b.apply("rem", count, every), zero)
        b.store(log, row, due, np.array([q, dq], object))
        pull = b.apply("add", b.apply("sin", q), b.apply("mul", damping, dq))
        faster = b.apply("sub", dq, b.apply("mul", h, pull))
        moved = b.apply("add", q, b.apply("mul", h, faster))
        return [b.apply("add", count, unit), b.apply("add", row, b.apply("convert", due, type="i64")), moved, faster]

    left = b.loop([zero, zero, *start], lambda carried: b.apply("lt", carried[0], steps), turn, iterations=steps)
    b.output("end", "f64", np.array(left[2:], object))
    return b.finish()


def pendulum_arrays():
    start = np.random.default_rng(0).normal(size=(RUNS, 2))
    return [start, np.array(0.3), np.array(STEPS), np.array(4)]


def assert_pendulum(log, end, accuracy):
    """Compare the log and the final state with NumPy."""
    state, *shared = pendulum_arrays()
    damping, steps, every = (x.item() for x in shared)
    expected = []
    for k in range(steps):
        if k % every == 0:
            expected.append(np.array(state))
        state[:, 1] = state[:, 1] - 0.01 * (np.sin(state[:, 0]) + damping * state[:, 1])
        state[:, 0] = state[:, 0] + 0.01 * state[:, 1]
    assert log.dtype == end.dtype == np.float64 and log.shape == (RUNS, STEPS // 4, 2)
    np.testing.assert_allclose(log, np.stack(expected, 1), rtol=accuracy)
    np.testing.assert_allclose(end, state, rtol=accuracy)


def batch(program, inputs, runs, rows, folder, real="double"):
    return CardOnTheProcessor(program, folder, real).batch(inputs, runs, rows)


needs_nvcc = pytest.mark.skipif(not shutil.which("nvcc"), reason="nvcc is not installed")


@needs_gxx
@pytest.mark.parametrize(("real", "accuracy"), [("double", 1e-13), ("float", 2e-5)])
def test_each_cuda_thread_computes_its_own_run(real, accuracy, tmp_path):
    done = batch(pendulum(), pendulum_arrays(), RUNS, STEPS // 4, tmp_path, real)
    assert_pendulum(*done, accuracy)


@needs_gxx
def test_random_programs_in_cuda_give_the_same_bits_as_llvm_code(tmp_path):
    llvm = pytest.importorskip("slidax.codegen.llvm")
    pytest.importorskip("llvmlite")
    from slidax.codegen.llvm.vectorise import lower_and_fuse

    arrays = [np.stack(parts) for parts in zip(*[random_arrays(k) for k in range(RUNS)], strict=True)]
    for seed in (7, 12):
        program = RandomProgram(seed, varying=True).finish()
        folder = tmp_path / str(seed)
        folder.mkdir()
        ours = batch(lower_and_fuse(program), arrays, RUNS, 0, folder)
        for ours_k, theirs_k in zip(ours, llvm.compile(program).batch(arrays, RUNS), strict=True):
            np.testing.assert_array_equal(ours_k, theirs_k, err_msg=f"seed {seed}")


@needs_nvcc
@pytest.mark.parametrize("real", ["double", "float"])
def test_nvcc_compiles_the_kernel(real, tmp_path):
    program = RandomProgram(12, varying=True).finish()
    source = tmp_path / "kernel.cu"
    for kernel in (pendulum(), program):
        source.write_text(cuda.cuda_code(kernel, real=real))
        command = ["nvcc", "-cubin", "-arch=sm_80", "-Werror", "all-warnings", "-o", str(tmp_path / "out"), str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_a_wrong_array_is_reported_by_its_name():
    program = pendulum()
    start, *shared = pendulum_arrays()
    with pytest.raises(DefinitionError, match=r"`state.start` must be float64 of shape \[5, 2\]; got float64 of shape"):
        pack_inputs(program, [start.T, *shared], RUNS, "double")
    with pytest.raises(DefinitionError, match="`steps` must be int64"):
        pack_inputs(program, [start, shared[0], np.array(3.0), shared[2]], RUNS, "double")
    with pytest.raises(DefinitionError, match="has 4 inputs; got 1"):
        pack_inputs(program, [start], RUNS, "double")


def test_a_cuda_kernel_without_a_gpu_is_refused_with_the_remedy():
    if cuda.card_available():
        pytest.skip("there is a card")
    with pytest.raises(
        DefinitionError, match=r"run `pip install \"slidax\[cuda\]\"`|install its driver|compute on the CPU"
    ):
        cuda.CudaKernel(pendulum())


def test_a_gpu_computes_all_runs():
    if not cuda.card_available():
        pytest.skip("CuPy or a card is missing")
    assert_pendulum(*cuda.CudaKernel(pendulum()).batch(pendulum_arrays(), RUNS, STEPS // 4), 1e-12)
