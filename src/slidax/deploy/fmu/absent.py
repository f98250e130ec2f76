"""Functions of FMI 3.0 that a co-simulation FMU without clocks and derivatives only declares."""

from __future__ import annotations

SELF = "fmi3Instance instance"
THESE = ("const fmi3ValueReference valueReferences[]", "size_t nValueReferences")
STATES = "size_t nContinuousStates"
SEEDS = (
    "const fmi3ValueReference unknowns[]",
    "size_t nUnknowns",
    "const fmi3ValueReference knowns[]",
    "size_t nKnowns",
    "const fmi3Float64 seed[]",
    "size_t nSeed",
    "fmi3Float64 sensitivity[]",
    "size_t nSensitivity",
)

ABSENT: dict[str, tuple[str, ...]] = {
    "fmi3EnterEventMode": (),
    "fmi3EnterStepMode": (),
    "fmi3EnterConfigurationMode": (),
    "fmi3ExitConfigurationMode": (),
    "fmi3EvaluateDiscreteStates": (),
    "fmi3EnterContinuousTimeMode": (),
    "fmi3GetDirectionalDerivative": SEEDS,
    "fmi3GetAdjointDerivative": SEEDS,
    "fmi3GetIntervalDecimal": (*THESE, "fmi3Float64 intervals[]", "fmi3IntervalQualifier qualifiers[]"),
    "fmi3GetIntervalFraction": (
        *THESE,
        "fmi3UInt64 counters[]",
        "fmi3UInt64 resolutions[]",
        "fmi3IntervalQualifier qualifiers[]",
    ),
    "fmi3GetShiftDecimal": (*THESE, "fmi3Float64 shifts[]"),
    "fmi3GetShiftFraction": (*THESE, "fmi3UInt64 counters[]", "fmi3UInt64 resolutions[]"),
    "fmi3SetIntervalDecimal": (*THESE, "const fmi3Float64 intervals[]"),
    "fmi3SetIntervalFraction": (*THESE, "const fmi3UInt64 counters[]", "const fmi3UInt64 resolutions[]"),
    "fmi3SetShiftDecimal": (*THESE, "const fmi3Float64 shifts[]"),
    "fmi3SetShiftFraction": (*THESE, "const fmi3UInt64 counters[]", "const fmi3UInt64 resolutions[]"),
    "fmi3UpdateDiscreteStates": (
        "fmi3Boolean *discreteStatesNeedUpdate",
        "fmi3Boolean *terminateSimulation",
        "fmi3Boolean *nominalsOfContinuousStatesChanged",
        "fmi3Boolean *valuesOfContinuousStatesChanged",
        "fmi3Boolean *nextEventTimeDefined",
        "fmi3Float64 *nextEventTime",
    ),
    "fmi3CompletedIntegratorStep": (
        "fmi3Boolean noSetFMUStatePriorToCurrentPoint",
        "fmi3Boolean *enterEventMode",
        "fmi3Boolean *terminateSimulation",
    ),
    "fmi3SetTime": ("fmi3Float64 time",),
    "fmi3SetContinuousStates": ("const fmi3Float64 continuousStates[]", STATES),
    "fmi3GetContinuousStateDerivatives": ("fmi3Float64 derivatives[]", STATES),
    "fmi3GetEventIndicators": ("fmi3Float64 eventIndicators[]", "size_t nEventIndicators"),
    "fmi3GetContinuousStates": ("fmi3Float64 continuousStates[]", STATES),
    "fmi3GetNominalsOfContinuousStates": ("fmi3Float64 nominals[]", STATES),
    "fmi3GetNumberOfEventIndicators": ("size_t *nEventIndicators",),
    "fmi3GetNumberOfContinuousStates": ("size_t *nContinuousStates",),
    "fmi3GetOutputDerivatives": (*THESE, "const fmi3Int32 orders[]", "fmi3Float64 values[]", "size_t nValues"),
    "fmi3ActivateModelPartition": ("fmi3ValueReference clockReference", "fmi3Float64 activationTime"),
}
"""Arguments after the instance, by function name."""
