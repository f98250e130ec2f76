"""The arm's side of a loop: the work of a robot's own computer and drives in one tick, here with a simulated arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arena import Arena, Plan

World = tuple[Any, np.ndarray, np.ndarray]
"""MuJoCo's model, and the indices of the joints' positions and velocities in it."""


class Arm:
    """A simulated arm that is moved tick by tick.

    - `plan`: its code: `set` takes a torque, `measure` measures, `move` moves the arm or computes MuJoCo's force.
    - `world`: MuJoCo's model; None for slidax's own arm.
    - `substeps`: MuJoCo's steps in a tick.
    """

    def __init__(self, plan: Plan, world: World | None, substeps: int) -> None:
        self.arena = Arena(plan)
        self._set, self._measure, self._move = (self.arena.routine(name) for name in ("set", "measure", "move"))
        view = self.arena.view
        self._k, self._i, self._brakes = (view(name) for name in ("k", "i", "brakes"))
        self._tick, self._applied, self._braking = (view(name) for name in ("true_k", "applied", "braking"))
        self.tau, self.fresh, self.q, self.dq = (view(name) for name in ("tau", "fresh", "q", "dq"))
        self.measured, self.row = self.arena.region("measured"), self.arena.region("row")
        pairs = ("delivery", "sensor", "state")
        self._pairs = {name: (self.arena.region(name), self.arena.region(f"{name}_after")) for name in pairs}
        self._world, self._substeps, self._force = world, substeps, view("force")
        for _ in range(2):
            for routine in (self._set, self._measure, self._move):
                routine()
        self.arena.reset()
        self.braking = False
        self._applied[()] = -1
        if world is not None:
            import mujoco

            self._simulator: Any = mujoco
            self._data = mujoco.MjData(world[0])
            self._data.qpos[world[1]], self._data.qvel[world[2]] = self.q, self.dq

    def set(self, k: int, arrived: bool) -> None:
        """Apply the torque in `tau` at tick `k` if its command arrived in time; else the previous torque stands."""
        self._k[()] = self._tick[()] = k
        self._brakes[()] = self._braking[()] = self.braking
        if arrived:
            self._applied[()] = k
        self._set()
        before, after = self._pairs["delivery"]
        before[:] = after

    def measure(self, k: int) -> bool:
        """Measure into `measured`; return False if this measurement is lost."""
        self._k[()] = k
        self._measure()
        before, after = self._pairs["sensor"]
        before[:] = after
        return bool(self.fresh)

    def move(self) -> bool:
        """Move on to the next tick; return True if the state is finite."""
        if self._world is None:
            self._move()
            before, after = self._pairs["state"]
            before[:] = after
        else:
            model, places, dofs = self._world
            for i in range(self._substeps):
                self._i[()] = i
                self._move()
                self._data.qfrc_applied[dofs] = self._force
                self._simulator.mj_step(model, self._data)
                self._data.qpos.take(places, out=self.q, mode="clip")
                self._data.qvel.take(dofs, out=self.dq, mode="clip")
        return bool(np.isfinite(self.q).all())

    @property
    def rests(self) -> bool:
        """True if the arm has come to rest."""
        return bool(np.abs(self.dq).max() < 1e-3)
