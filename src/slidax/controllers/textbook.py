"""Textbook controllers for comparison; the gains are our own choice, for arms like the paper's."""

from __future__ import annotations

from slidax.surfaces import Linear
from slidax.transformations import PrescribedPerformance, Unconstrained

from .computed_torque import ComputedTorque
from .gravity_compensated_pd import GravityCompensatedPD
from .joint_pid import JointPID
from .preset import Given, Preset
from .sliding_mode import SlidingMode
from .slotine_li import SlotineLi
from .super_twisting import SuperTwisting

OURS = "our choice"

sliding_mode = Preset(SlidingMode, "The law (41)-(45) on any surface, with any transformation, reaching law and bound.")

slotine_li = Preset(
    SlotineLi,
    "The classical sliding mode law with a boundary layer (Slotine and Li).",
    source=OURS,
    transformation=Given(Unconstrained),
    surface=Given(Linear, rate=5.0),
    damping=20.0,
    gain=20.0,
    layer=0.05,
)

slotine_li_ppc = Preset(
    SlotineLi,
    "The classical sliding mode law inside an envelope.",
    source=OURS,
    transformation=Given(PrescribedPerformance),
    surface=Given(Linear, rate=0.6),
    damping=20.0,
    gain=20.0,
    layer=0.05,
)

super_twisting = Preset(
    SuperTwisting,
    """Super-twisting on a linear surface (Levant; Moreno and Osorio).

    For a disturbance whose rate is at most L [rad/s³]: `k1 = 1.5 √L`, `k2 = 1.1 L`.
    """,
    source=OURS,
    transformation=Given(Unconstrained),
    surface=Given(Linear, rate=5.0),
    k1=12.0,
    k2=70.0,
)

computed_torque = Preset(
    ComputedTorque,
    """Computed torque with PD feedback.

    In sampled-data form the estimator makes it computed torque with a disturbance observer.
    """,
    source=OURS,
    kp=100.0,
    kd=20.0,
)

gravity_pd = Preset(GravityCompensatedPD, "PD feedback with gravity compensation.", source=OURS, kp=400.0, kd=100.0)

pid = Preset(
    JointPID,
    """A PID controller at each joint, which knows nothing of the arm.

    As in usual drives: no model and no feed-forward. The integral stops at the torque limit of the drives.
    """,
    source=OURS,
    kp=400.0,
    ki=800.0,
    kd=100.0,
    gravity=0.0,
)
