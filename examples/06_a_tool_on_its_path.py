"""A Panda draws a circle with its tool upright, by inverse kinematics, and how far the tool is off in a run.

Usage: python examples/06_a_tool_on_its_path.py
"""

import numpy as np

import slidax as sx
from slidax.arms import Pose, inverse
from slidax.motions import Circle, Line, follow

arm = sx.arms.panda()
home = np.asarray(sx.arms.built_in_arm("panda").home)
pose = Pose.of_tip(arm, home)

# One pose, and the posture for it that is nearest to home.
lower = Pose(pose.position + np.array([0.1, 0.0, -0.15]), pose.rotation)
solution = inverse(arm, lower, start=home)
print("posture:", solution.q.round(4), f"off by {solution.position_error:.0e} m")

# A path: down to that pose as fast as the joints can, then once around.
center = lower.position + np.array([0.0, 0.1, 0.0])
moves = [Line(to=lower.position), Circle(center=center, axis=[0, 0, 1], speed=0.25, acceleration=1.0)]
path = follow(arm, moves, start=home, velocity=np.asarray(arm.limits.velocity), acceleration=6.0)
print(path)

# The law follows, with 2 kg at the tool that it does not know, links 15 % lighter, and encoders alone.
changes = {"start.q": home.tolist(), "simulation.t1": 4.0, "simulation.log_every": 10}
scenario = sx.scenarios.load("panda-payload", changes).replace(trajectory=path.trajectory)
run = scenario.simulate()
actual, desired = sx.report.tip_paths(arm, run)
print(run.outcome.message or run.outcome.kind, f"tool within {np.linalg.norm(actual - desired, axis=1).max():.1e} m")
sx.report.figures.tip_path(actual, desired).savefig("tool.svg")
