"""The scenario's arm as a ROS 2 node: an effort in, a joint state out, step by step; run by the Python that has rclpy.

    python ros2_arm.py FOLDER STEPS

FOLDER has the exported package. After 100 steps it sends a trajectory to 0.3 rad from where it stands, in 2 s. Prints
one JSON object: how many states and efforts were exchanged, how far the arm is from its goal, and what the law told.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

FIRST = 100
"""Steps before the trajectory."""

WAY, SECONDS = 0.3, 2


def main() -> None:
    """Moves the arm until all steps are done, or nothing has come for a while."""
    folder, steps = Path(sys.argv[1]), int(sys.argv[2])
    sys.path.insert(0, str(folder))
    import rclpy
    from law import Law
    from rehearsal import Arm
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    law = Law(folder / "law")
    arm = Arm(law)
    names = [f"joint_{k}" for k in range(1, law.joints + 1)]
    rclpy.init()
    ros = rclpy.create_node("arm")
    states = ros.create_publisher(JointState, "joint_states", 10)
    trajectories = ros.create_publisher(JointTrajectory, "/slidax/joint_trajectory", 10)
    efforts: list[Any] = []
    told: list[Any] = []
    ros.create_subscription(JointState, "/slidax/effort", efforts.append, 10)
    ros.create_subscription(Float64MultiArray, "/slidax/state", told.append, 10)
    until = time.monotonic() + 30.0
    while time.monotonic() < until:
        if states.get_subscription_count() and ros.count_publishers("/slidax/effort"):
            break
        rclpy.spin_once(ros, timeout_sec=0.05)
    goal = list(arm.measured()[0])
    goal[0] += WAY
    received = 0
    for step in range(steps):
        q, dq = arm.measured()
        message = JointState(name=names, position=q, velocity=dq)
        at = step * law.period
        message.header.stamp.sec = int(at)
        message.header.stamp.nanosec = round(1e9 * (at - int(at)))
        if step == FIRST:
            point = JointTrajectoryPoint(positions=goal)
            point.time_from_start.sec = SECONDS
            trajectories.publish(JointTrajectory(joint_names=names, points=[point]))
            # It is taken between two states: all that was sent is there before the next one.
            time.sleep(0.2)
        states.publish(message)
        patience = time.monotonic() + 5.0
        while len(efforts) <= received and time.monotonic() < patience:
            rclpy.spin_once(ros, timeout_sec=0.05)
        if len(efforts) <= received:
            break
        received = len(efforts)
        arm.move(efforts[-1].effort)
    for _ in range(20):
        rclpy.spin_once(ros, timeout_sec=0.01)
    last = told[-1]
    signals = (
        {each.label: list(last.data[each.stride : each.stride + each.size]) for each in last.layout.dim} if told else {}
    )
    q = arm.measured()[0]
    print(
        json.dumps(
            {
                "sent": step + 1,
                "received": received,
                "told": len(told),
                "off": max(abs(a - b) for a, b in zip(q, goal, strict=True)),
                "signals": signals,
            }
        )
    )
    ros.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
