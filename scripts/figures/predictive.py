"""Model predictive control of seven joints by TinyMPC and acados: times, and difference to a linear law."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

JOINTS, PERIOD, LIMIT = 7, 1e-3, 20.0
"""Number of joints, the period [s], and the limit of each acceleration [rad/s²]."""

STATE, INPUT = np.diag([1e4] * JOINTS + [1.0] * JOINTS), 0.01 * np.eye(JOINTS)
"""Weights of position and velocity errors, and of accelerations."""

IDENTITY, ZERO = np.eye(JOINTS), np.zeros((JOINTS, JOINTS))
A = np.block([[IDENTITY, PERIOD * IDENTITY], [ZERO, IDENTITY]])
B = np.vstack([0.5 * PERIOD**2 * IDENTITY, PERIOD * IDENTITY])
Solver = Callable[[np.ndarray], np.ndarray]


def regulator() -> tuple[np.ndarray, np.ndarray]:
    """The gain of the linear-quadratic regulator with these weights, and its cost matrix."""
    cost = STATE
    for _ in range(20_000):
        gain = np.linalg.solve(INPUT + B.T @ cost @ B, B.T @ cost @ A)
        cost = STATE + A.T @ cost @ (A - B @ gain)
    return gain, cost


def tinympc(horizon: int) -> Solver:
    """TinyMPC, an ADMM with its own terminal cost."""
    import tinympc as package

    solver = package.TinyMPC()
    limit = np.full(JOINTS, LIMIT)
    options = {"max_iter": 1000, "abs_pri_tol": 1e-6, "abs_dua_tol": 1e-6, "check_termination": 1}
    solver.setup(A, B, STATE, INPUT, horizon, rho=0.1, u_min=-limit, u_max=limit, **options)

    def solve(x: np.ndarray) -> np.ndarray:
        solver.set_x0(x)
        return np.array(solver.solve()["controls"]).ravel()

    return solve


def acados(horizon: int) -> Solver:
    """HPIPM behind acados, with the regulator's cost at the end; needs CasADi and a C compiler."""
    import acados as package

    source = Path(package.__file__).parent
    os.environ["ACADOS_SOURCE_DIR"] = str(source / "install")
    sys.path.insert(0, str(source))
    import casadi
    from acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver

    # The wheel has the templates elsewhere than its own generator looks for them.
    place = source / "install" / "interfaces" / "acados_template" / "acados_template"
    if not place.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(source / "acados_template")
    x, u, n = casadi.SX.sym("x", 2 * JOINTS), casadi.SX.sym("u", JOINTS), 2 * JOINTS
    model, problem = AcadosModel(), AcadosOcp()
    model.name, model.x, model.u = "joints", x, u
    model.disc_dyn_expr = casadi.mtimes(A, x) + casadi.mtimes(B, u)
    problem.model, problem.dims.N, problem.solver_options.tf = model, horizon, float(horizon)
    cost, constraints, options = problem.cost, problem.constraints, problem.solver_options
    cost.cost_type = cost.cost_type_e = "LINEAR_LS"
    cost.W = np.block([[STATE, np.zeros((n, JOINTS))], [np.zeros((JOINTS, n)), INPUT]])
    cost.Vx, cost.Vu = np.vstack([np.eye(n), np.zeros((JOINTS, n))]), np.vstack([np.zeros((n, JOINTS)), IDENTITY])
    cost.W_e, cost.Vx_e, cost.yref, cost.yref_e = regulator()[1], np.eye(n), np.zeros(n + JOINTS), np.zeros(n)
    constraints.lbu, constraints.ubu = np.full(JOINTS, -LIMIT), np.full(JOINTS, LIMIT)
    constraints.idxbu, constraints.x0 = np.arange(JOINTS), np.zeros(n)
    options.qp_solver, options.integrator_type = "PARTIAL_CONDENSING_HPIPM", "DISCRETE"
    options.nlp_solver_type, options.hessian_approx = "SQP_RTI", "GAUSS_NEWTON"
    solver = AcadosOcpSolver(problem, json_file="problem.json", verbose=False)

    def solve(x: np.ndarray) -> np.ndarray:
        solver.set(0, "lbx", x)
        solver.set(0, "ubx", x)
        solver.solve()
        return np.array(solver.get(0, "u"))

    return solve


def measure_predictive() -> None:
    """Time TinyMPC and acados on seven double integrators at 1 kHz, and compare them with linear laws.

    The packages are not needed by slidax: `pip install tinympc`, `pip install comma-deps-acados`, in an environment of
    their own, with `LD_LIBRARY_PATH` at the libraries of acados.
    """
    parser = argparse.ArgumentParser(description=measure_predictive.__doc__)
    parser.add_argument("--horizons", type=int, nargs="*", default=[10, 20], help="periods")
    parser.add_argument("--solves", type=int, default=1000, help="of each size of the errors")
    arguments = parser.parse_args()
    gain, _ = regulator()
    print("| solver | horizon | limits act | median [µs] | 99 % | to the clipped regulator | to a linear law |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    makers: list[Any] = [tinympc, acados]
    for make in makers:
        for horizon in arguments.horizons:
            for scale in (1e-4, 1e-2):
                try:
                    print(_row(make, horizon, scale, arguments.solves, gain), flush=True)
                except ImportError as error:
                    print(f"{make.__name__}: {error}", file=sys.stderr)


def _row(make: Any, horizon: int, scale: float, solves: int, gain: np.ndarray) -> str:
    rng = np.random.default_rng(0)
    errors = scale * rng.normal(size=(solves + 30, 2 * JOINTS)) * np.repeat([1.0, 10.0], JOINTS)
    with tempfile.TemporaryDirectory() as folder, Quietly(Path(folder)):
        solve = make(horizon)
        seconds, answers = [], []
        for x in errors:
            started = time.perf_counter()
            answers.append(solve(x))
            seconds.append(time.perf_counter() - started)
    inputs, times = np.array(answers), 1e6 * np.array(seconds[30:])
    clipped = np.clip(-errors @ gain.T, -LIMIT, LIMIT)
    fitted = np.clip(errors @ np.linalg.lstsq(errors, inputs, rcond=None)[0], -LIMIT, LIMIT)
    apart = [np.abs(inputs - other).max() / np.abs(inputs).max() for other in (clipped, fitted)]
    acts = np.mean(np.abs(inputs) > 0.999 * LIMIT)
    cells = [
        make.__name__,
        horizon,
        f"{100 * acts:.0f} %",
        f"{np.median(times):.0f}",
        f"{np.percentile(times, 99):.0f}",
    ]
    return f"| {' | '.join(map(str, [*cells, *(f'{value:.1g}' for value in apart)]))} |"


class Quietly:
    """Work in a folder, without what the solvers print from C."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __enter__(self) -> None:
        sys.stdout.flush()
        self.before, self.output, nothing = Path.cwd(), os.dup(1), os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.close(nothing)
        os.chdir(self.folder)

    def __exit__(self, *_: object) -> None:
        sys.stdout.flush()
        os.chdir(self.before)
        os.dup2(self.output, 1)
        os.close(self.output)
