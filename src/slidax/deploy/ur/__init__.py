"""The law on an arm of Universal Robots: a program around ur_rtde."""

from .export import export_ur as export_ur
