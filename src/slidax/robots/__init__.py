"""Robot arms: inertia, bias and tip. One class serves as the true robot and as the nominal one that a law knows."""

from .robot import AbstractRobot as AbstractRobot
from .scara import Scara as Scara
from .two_link import TwoLink as TwoLink
