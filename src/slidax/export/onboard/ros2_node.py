"""The exported law as a ROS 2 node. Runs without slidax."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .pilot import FINISH, STOP, CompiledLaw, load_law


class Node:
    """ROS 2 node that runs the law once for each JointState message.

    - `ros`: an `rclpy` node.
    - `joints`: names of the joints, in the law's order.
    - `messages`: the message classes JointState, JointTrajectory, Float64MultiArray and MultiArrayDimension.
    """

    def __init__(self, ros: Any, law: CompiledLaw, joints: Sequence[str], messages: Sequence[Any]) -> None:
        self.ros, self.law, self.joints = ros, law, list(joints)
        self.JointState, trajectory, self.State, self.Dimension = messages
        self.pilot = law.pilot()
        self.pilot.options.follows = True
        self.pilot.options.path.hold = 0.0
        self.before: float | None = None
        self.ended = False
        self.effort = ros.create_publisher(self.JointState, "~/effort", 10)
        self.state = ros.create_publisher(self.State, "~/state", 10)
        ros.create_subscription(self.JointState, "joint_states", self.measured, 10)
        ros.create_subscription(trajectory, "~/joint_trajectory", self.wanted, 10)

    def measured(self, message: Any) -> None:
        """Run one period with a JointState, whose stamp is the time, and publish the effort."""
        if self.ended:
            return
        try:
            order = [list(message.name).index(name) for name in self.joints]
            q = [message.position[k] for k in order]
            dq = [message.velocity[k] for k in order]
        except (ValueError, IndexError):
            self.ros.get_logger().error("joint state ignored: it lacks the position or velocity of a joint")
            return
        now = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        if self.before is None and not self.pilot.begin(q):
            self._end()
            return
        elapsed = 0.0 if self.before is None else now - self.before
        self.before = now
        action = self.pilot.step(elapsed, q, dq)
        answer = self.JointState()
        answer.header.stamp = message.header.stamp
        answer.name = self.joints
        answer.effort = list(self.pilot.report.tau)
        self.effort.publish(answer)
        self.state.publish(self._told())
        if action in (FINISH, STOP):
            self._end()

    def wanted(self, message: Any) -> None:
        """Follow a JointTrajectory with all joints of the law, in any order; ignore other joints with a warning."""
        logger = self.ros.get_logger()
        names = list(message.joint_names)
        obstacle = self._obstacle(message)
        if obstacle:
            logger.error(f"trajectory rejected: {obstacle}")
            return
        others = [name for name in names if name not in self.joints]
        if others:
            logger.warning(f"trajectory joints unknown to the law are ignored: {', '.join(others)}")
        order = [names.index(name) for name in self.joints]
        times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in message.points]
        parts = []
        for part in ("positions", "velocities", "accelerations"):
            rows = [getattr(point, part) for point in message.points]
            whole = all(len(row) == len(names) for row in rows)
            parts.append([[row[k] for k in order] for row in rows] if whole else None)
        if parts[0] is None:
            logger.error("trajectory rejected: a point lacks the position of a joint")
            return
        refused = self.pilot.take(times, parts[0], parts[1], parts[2] if parts[1] else None)
        if refused:
            logger.error(f"trajectory rejected: {refused}")

    def _obstacle(self, message: Any) -> str:
        """Return the reason for which the node cannot take a JointTrajectory, or ""."""
        if self.ended:
            return f"the law has stopped: {self.pilot.why}; start the node again"
        if self.before is None:
            return "no joint state has come yet; send it again after the first one"
        names = list(message.joint_names)
        wrong = [name for name in self.joints if names.count(name) != 1]
        if wrong or not message.points:
            what = f"it must have the joint {wrong[0]} once" if wrong else "it has no points"
            return f"{what}; its joints are {', '.join(names)}"
        return ""

    def _end(self) -> None:
        self.ended = True
        self.ros.get_logger().error(f"stopped: {self.pilot.why}")

    def _told(self) -> Any:
        """Return the state message: signals, errors and status, each with its name as a label in the layout."""
        report = self.pilot.report
        numbers = {
            **self.pilot.signals(),
            "error": list(report.error),
            "margin": [report.margin],
            "status": [float(report.status)],
            "phase": [float(report.phase)],
            "reason": [float(report.reason)],
        }
        message = self.State()
        for name, values in numbers.items():
            message.layout.dim.append(self.Dimension(label=name, size=len(values), stride=len(message.data)))
            message.data.extend(values)
        return message


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return the exit code: 0 at its end, 5 if ROS 2 is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--law", type=Path, default=Path(__file__).parent / "law", help="folder of the exported law")
    parser.add_argument(
        "--joints", nargs="+", help="joint names in the law's order; by default those of the robot's file"
    )
    options, rest = parser.parse_known_args(arguments)
    try:
        import rclpy
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray, MultiArrayDimension
        from trajectory_msgs.msg import JointTrajectory
    except ImportError as error:
        print(f"ROS 2 is missing: {error}", file=sys.stderr)
        return 5
    law = load_law(parser, options.law)
    rclpy.init(args=rest)
    ros = rclpy.create_node("slidax")
    joints = options.joints or law.about["names"]
    if len(joints) != law.joints:
        parser.error(f"--joints must be {law.joints} names; got {len(joints)}")
    Node(ros, law, joints, (JointState, JointTrajectory, Float64MultiArray, MultiArrayDimension))
    try:
        rclpy.spin(ros)
    except KeyboardInterrupt:
        pass
    finally:
        ros.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
