"""franka-sim on loopback with all that it can enforce; run by the Python that has it, with FR3_MJCF set.

franka-sim moves the arm by one clock and tells its state by another, so that now and then a state repeats or leaves out
a millisecond: at 1 rad/s that is a jump of 1e-3 rad, which no robot's encoder makes. Here the arm moves one step for
each state that is told, as a robot does, which has one clock. `--two-clocks` leaves it as it is.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import sys
import threading
import time
from typing import Any

import mujoco
from franka_sim import FrankaSimServer
from franka_sim.mujoco_franka_sim import MujocoFrankaSim


class OneClock(MujocoFrankaSim):
    """The arm, moved by whoever tells its state; by itself while nobody listens."""

    def __init__(self) -> None:
        super().__init__()
        self.teller: int | None = None
        self.moving = threading.Lock()

    def get_robot_state(self) -> dict[str, Any]:
        """The latest state; one step later for the thread that tells it."""
        if threading.get_ident() == self.teller:
            self.move()
        return super().get_robot_state()

    def move(self) -> None:
        """One step."""
        with self.moving:
            self._apply_control()
            mujoco.mj_step(self.model, self.data)
            self._read_and_publish_state()

    def run_simulation(self) -> None:
        """Moves the arm while nobody listens."""
        while self.running:
            time.sleep(self.dt)
            if self.teller is None:
                self.move()


class Server(FrankaSimServer):
    """Tells the arm which thread is its clock."""

    def start_robot_state_transmission(self, client_address: str, client_udp_port: int) -> None:
        """Sends states until the client is gone."""
        self.physics_sim.teller = threading.get_ident()
        try:
            super().start_robot_state_transmission(client_address, client_udp_port)
        finally:
            self.physics_sim.teller = None


def main() -> None:
    """Serves until it is ended."""
    options = {"host": "127.0.0.1", "enable_gripper": False}
    options |= {"enforce_comm_constraints": True, "enforce_motion_limits": True}
    # Its threads must be in time, also where others are busy.
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))
    sys.setswitchinterval(1e-4)
    gc.disable()
    server = FrankaSimServer(**options) if "--two-clocks" in sys.argv else Server(physics_sim=OneClock(), **options)
    server.start()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    main()
