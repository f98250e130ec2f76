"""Control laws: envelopes, error transformations, surfaces, reaching laws, estimators, adaptation and controllers.

A sliding-mode controller has four parts: `envelopes.py` prescribes the error bounds, `error_transformations.py` maps
the error inside its bounds to an unbounded variable, `surfaces.py` defines the motion on the sliding surface, and
`reaching_laws.py` the torque that reaches it. `presets.py` lists all named schemes with their parameter values.

`sliding_mode_controllers.py` and `linear_controllers.py` hold the controllers as printed in papers. `sampled` holds
their sampled-data form with estimator, prediction over the delay and torque limits.

Read first: `presets.py`, `sliding_mode_controllers.py`, `sampled/controller.py`.
"""

from .adaptation import AbstractAdaptation as AbstractAdaptation
from .adaptation import Experience as Experience
from .adaptation import KnownJoints as KnownJoints
from .adaptation import LearnedParameters as LearnedParameters
from .arm_learning import ArmLearning as ArmLearning
from .arm_model import ArmParameters as ArmParameters
from .arm_model import KnownArm as KnownArm
from .calm_step import Calm as Calm
from .calm_step import CalmStep as CalmStep
from .controllers import AbstractController as AbstractController
from .controllers import AbstractModelBased as AbstractModelBased
from .controllers import AbstractSurfaceBased as AbstractSurfaceBased
from .envelopes import AbstractPerformance as AbstractPerformance
from .envelopes import Exponential as Exponential
from .envelopes import FiniteTime as FiniteTime
from .envelopes import FixedTime as FixedTime
from .error_transformations import AbstractTransformation as AbstractTransformation
from .error_transformations import EnvelopeFrame as EnvelopeFrame
from .error_transformations import PrescribedPerformance as PrescribedPerformance
from .error_transformations import Sides as Sides
from .error_transformations import TransformedError as TransformedError
from .error_transformations import Unconstrained as Unconstrained
from .estimators import AbstractEstimator as AbstractEstimator
from .estimators import Estimate as Estimate
from .estimators import FilteredDifference as FilteredDifference
from .estimators import Measured as Measured
from .estimators import RobustDifferentiator as RobustDifferentiator
from .joint_learning import JointLearning as JointLearning
from .kalman import Kalman as Kalman
from .kalman import StrongTracking as StrongTracking
from .linear_controllers import ComputedTorque as ComputedTorque
from .linear_controllers import GravityCompensatedPD as GravityCompensatedPD
from .linear_controllers import JointPID as JointPID
from .presets import Preset as Preset
from .presets import PresetPart as PresetPart
from .presets import anftsmc as anftsmc
from .presets import cftsmppc as cftsmppc
from .presets import computed_torque as computed_torque
from .presets import ftsmc as ftsmc
from .presets import ftsmppc as ftsmppc
from .presets import gravity_pd as gravity_pd
from .presets import nftsmc as nftsmc
from .presets import pid as pid
from .presets import sfsmc as sfsmc
from .presets import sfsmppc as sfsmppc
from .presets import sliding_mode as sliding_mode
from .presets import slotine_li as slotine_li
from .presets import slotine_li_ppc as slotine_li_ppc
from .presets import super_twisting as super_twisting
from .reaching_laws import AbstractReaching as AbstractReaching
from .reaching_laws import FixedTimeReaching as FixedTimeReaching
from .reaching_laws import SaturatedReaching as SaturatedReaching
from .reaching_laws import TwoPowerReaching as TwoPowerReaching
from .sampled.controller import SampledData as SampledData
from .sampled.gate import Admission as Admission
from .sampled.gate import GateMemory as GateMemory
from .sampled.gate import MeasurementGate as MeasurementGate
from .sampled.monitor import Monitor as Monitor
from .sampled.recipe import sampled_data as sampled_data
from .sliding_mode_controllers import AdaptiveNonsingularFastTerminal as AdaptiveNonsingularFastTerminal
from .sliding_mode_controllers import NonsingularFastTerminal as NonsingularFastTerminal
from .sliding_mode_controllers import SlidingMode as SlidingMode
from .sliding_mode_controllers import SlotineLi as SlotineLi
from .sliding_mode_controllers import SuperTwisting as SuperTwisting
from .sliding_mode_controllers import TwistingMemory as TwistingMemory
from .steps import AbstractStep as AbstractStep
from .steps import Decision as Decision
from .steps import Recovery as Recovery
from .steps import StepInput as StepInput
from .surfaces import AbstractSurface as AbstractSurface
from .surfaces import Linear as Linear
from .surfaces import LinearCoreFixedTime as LinearCoreFixedTime
from .surfaces import SingularityFree as SingularityFree
from .surfaces import SlidingVariable as SlidingVariable
from .surfaces import SmoothFixedTime as SmoothFixedTime
from .surfaces import sliding_variable as sliding_variable
from .torque_bounds import AbstractBound as AbstractBound
from .torque_bounds import FixedBound as FixedBound
from .torque_bounds import StateBound as StateBound
from .torque_bounds import UncertaintyBound as UncertaintyBound
