"""Adaptation laws for the rotor inertia and the Coulomb friction of each joint."""

from .adaptation import AbstractAdaptation as AbstractAdaptation
from .adaptation import Experience as Experience
from .adaptation import Learnt as Learnt
from .joint_learning import JointLearning as JointLearning
from .known_joints import KnownJoints as KnownJoints
