"""Every adaptation: one line here enrols a new one in `tests/laws/test_adaptations.py`. All are for two joints."""

from slidax.law import AbstractAdaptation, JointLearning, KnownJoints

ADAPTATIONS: list[tuple[str, AbstractAdaptation]] = [
    ("joint_learning", JointLearning(rotor=0.1, rotor_min=0.01, rotor_max=2.0, coulomb_max=3.0)),
    ("joint_learning_of_inertia_alone", JointLearning(counted=[0.1, 0.0], rotor=[0.1, 0.02], rotor_max=[1.0, 5.0])),
    ("known_joints", KnownJoints(counted=0.1, rotor=[0.05, 0.2], coulomb=[0.0, 0.4])),
]
