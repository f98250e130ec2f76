"""Families of scenarios: all scenarios that a file and its uncertainty sets allow.

A case is one scenario of the family: a value for each path that has a set. `truth` in its description holds the values
of the true loop that the law does not know.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError, locate_errors
from slidax.core.types import Envelope, State
from slidax.law.controllers import AbstractController
from slidax.simulation.plant import MujocoPlant
from slidax.simulation.simulate import Parts

from .changes import path_in
from .load import validate_text
from .scenario import KNOWN_TO_LAW_REMEDY, OF_THE_LAW, OpenLoop, Scenario, ScenarioDescription
from .uncertain_values import Array, Leaf, is_index, leaf_of, with_values
from .uncertainty import AbstractSet, InertialBand, InsideEnvelope


@dataclass(frozen=True)
class Space:
    """Sets of values for paths of a scenario, with a map from points of a unit cube to these values.

    Each set maps its own coordinates of a point to a value. The coordinates are in the order of the paths.

    - `leaves`: the scenario's own values, with units and ranges, by path.
    - `sets`: the sets, by path.
    """

    leaves: Mapping[str, Leaf]
    sets: Mapping[str, AbstractSet]

    @cached_property
    def widths(self) -> dict[str, int]:
        """Number of coordinates of the unit cube for each path."""
        return {path: values.coordinates(self.leaves[path]) for path, values in self.sets.items()}

    @property
    def dimensions(self) -> int:
        """Dimension of the unit cube."""
        return sum(self.widths.values())

    @property
    def coordinates(self) -> list[str]:
        """Names of the coordinates of the unit cube."""
        return [path if width == 1 else f"{path}[{k}]" for path, width in self.widths.items() for k in range(width)]

    def values(self, cube: Array) -> dict[str, Array]:
        """Return the values at points of the unit cube, by path; the first axis of each array is the point.

        - `cube`: points [rows, dimensions], in [0, 1).

        Raises DefinitionError, with the path, if a set does not fit the scenario's value, or is empty.
        """
        if cube.shape[1:] != (self.dimensions,):
            raise DefinitionError(f"points of the cube have {self.dimensions} coordinates; got {list(cube.shape)}")
        values, first = {}, 0
        for path, choices in self.sets.items():
            width = self.widths[path]
            with locate_errors(path):
                values[path] = choices.values(cube[:, first : first + width], self.leaves[path])
            first += width
        return values

    def ends(self) -> list[dict[str, Any]]:
        """Return four cases at the ends of the sets, each with its values by path.

        They are all values low, all high, and low and high in turn from path to path, starting with either.
        """
        low, high = 0.0, np.nextafter(1.0, 0.0)
        even = np.repeat(np.arange(len(self.widths)) % 2 == 0, list(self.widths.values()))
        points = np.array([np.full(len(even), low), np.full(len(even), high), *np.where([even, ~even], low, high)])
        drawn = self.values(points)
        return [{path: values[k] for path, values in drawn.items()} for k in range(len(points))]


def as_changes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a case's values by path, with the arrays converted to numbers and lists, as in a scenario file."""
    return {path: np.asarray(value).tolist() for path, value in values.items()}


UNTRACEABLE = (TypeError, ValueError, AttributeError, DefinitionError)
"""Errors that the use of a traced array may raise."""


@dataclass(frozen=True, eq=False)
class Family:
    """All scenarios that a file and sets of values allow.

    - `base`: description of the scenario in the file.
    - `uncertain`: sets of true values that the law does not know.
    - `varied`: sets of values that the law knows, as with `--set`.
    """

    base: ScenarioDescription
    uncertain: Space
    varied: Space

    @classmethod
    def of(
        cls,
        base: ScenarioDescription,
        uncertain: Mapping[str, AbstractSet] | None = None,
        varied: Mapping[str, AbstractSet] = {},
    ) -> Family:
        """Return the family of a scenario.

        - `base`: description of the scenario.
        - `uncertain`: sets by dotted path of true values that the law does not know; default: the scenario's own.
        - `varied`: sets by dotted path of values that the law knows.

        Raises DefinitionError if a path does not exist, a set is empty, or a value is out of its range.
        """
        resolved = base.model_copy(update={"robot": base.robot.resolved()})
        spaces = {}
        for where, sets in (
            ("uncertainty", base.uncertainty if uncertain is None else uncertain),
            ("varied", varied),
        ):
            with locate_errors(where):
                spaces[where] = _space(resolved, sets, law=where == "varied")
        both = [path for path in spaces["uncertainty"].sets if path in spaces["varied"].sets]
        if both:
            raise DefinitionError(
                "is among the uncertain and the varied values: remove it from one of the two",
                where=f"uncertainty.{both[0]}",
            )
        family = cls(resolved, spaces["uncertainty"], spaces["varied"])
        family.require_valid()
        return family

    @cached_property
    def space(self) -> Space:
        """Space of all sets, those of the uncertain values first."""
        return Space({**self.uncertain.leaves, **self.varied.leaves}, {**self.uncertain.sets, **self.varied.sets})

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the robot's joints."""
        return self.arm.joint_names

    @cached_property
    def arm(self) -> AbstractRobot:
        """The true arm."""
        return _arm(self.base)

    def label(self, column: str) -> str:
        """Return the name of a study's column with a joint's name as index, a form that `--set` also accepts.

        `start.q[3]` or `start.q.3` becomes `start.q[elbow]`.
        """
        path, _, indices = column.partition("[")
        leaf = self.space.leaves[path]
        if not indices and is_index(path.rpartition(".")[2]):
            path, _, index = path.rpartition(".")
            return f"{path}[{self.joint_names[int(index)]}]" if leaf.one_of_joints else f"{path}[{index}]"
        if leaf.each_joint and is_index(indices[:-1]):
            return f"{path}[{self.joint_names[int(indices[:-1])]}]"
        return column

    def require_valid(self) -> None:
        """Raise DefinitionError, with the path, if a scenario at one of `Space.ends` is invalid.

        The uncertain and the varied sets are tested one after the other; all other values are the file's.
        """
        for where, space in (("uncertainty", self.uncertain), ("varied", self.varied)):
            with locate_errors(where):
                ends = space.ends() if space.sets else []
            for values in ends:
                try:
                    self._require_buildable(values, space)
                except DefinitionError as error:
                    raise self._with_path(where, space, values, error) from None

    def _require_buildable(self, values: Mapping[str, Any], space: Space) -> None:
        case = self.case(values)
        if space is self.varied:
            case.build("end")
        else:
            case.as_it_is().moving()

    def _with_path(
        self, where: str, space: Space, values: Mapping[str, Any], error: DefinitionError
    ) -> DefinitionError:
        """The error, with the path of a set that causes it on its own, or else with the path of all sets."""
        for path, value in values.items():
            try:
                self._require_buildable({path: value}, space)
            except DefinitionError as single:
                return DefinitionError(single.message, where=f"{where}.{path}")
        return DefinitionError(f"some of its values do not fit together: {error}", where=where)

    def case(self, values: Mapping[str, Any]) -> ScenarioDescription:
        """Return the description of a case.

        Varied values replace the file's. Uncertain values are added to the description's `truth`.

        - `values`: the case's values by dotted path.

        Raises DefinitionError if a value is invalid.
        """
        changes = as_changes(values)
        known = {path: value for path, value in changes.items() if path in self.varied.sets}
        true = {path: value for path, value in changes.items() if path in self.uncertain.sets}
        data = self.base.model_dump(exclude_unset=True, exclude={"uncertainty"})
        data["truth"] = {**self.base.truth, **true}
        return validate_text(data, known, form=type(self.base))

    def scenario(self, values: Mapping[str, Any], name: str) -> Scenario:
        """Build the scenario of a case.

        - `values`: the case's values by dotted path.
        - `name`: the scenario's name.

        Raises DefinitionError if a value is invalid.
        """
        return self.case(values).build(name)

    def parts(self, template: Templates, values: Mapping[str, Any]) -> Parts:
        """Return the parts of a case's closed loop, as `simulate` takes them.

        - `template`: another case, which supplies all values that are not in `values`.
        - `values`: values by dotted path, which JAX may trace and which are not validated.
        """
        known = {path: value for path, value in values.items() if path in self.varied.sets}
        controller = template.controller
        if known:
            nominal = with_values(template.believed, known)
            controller = nominal.law(nominal.moving())
        actual: OpenLoop = with_values(template.actual, values).moving()
        if isinstance(actual.plant, MujocoPlant):
            raise DefinitionError("MuJoCo simulates one arm at a time, not a batch: set `simulation.plant` to `own`")
        parts = actual.plant, controller, actual.trajectory, actual.state0
        tolerance = template.built.tolerance
        return parts if tolerance is None else (*parts, tolerance)

    def traceable(self, template: Templates, values: Mapping[str, Array]) -> dict[str, bool]:
        """Return for each path True if one compiled loop can run all values of this path.

        A value that cannot be an array in the compiled loop, such as a period, needs a loop of its own.

        - `template`: a case, which supplies the values of all other paths.
        - `values`: some values for each path; the first axis of each array is the case.
        """
        known: Any = jax.tree.structure((self.parts(template, {}),))
        traceable = {}
        for path, some in values.items():

            def probe(value: Any, path: str = path) -> Any:
                if jax.tree.structure((self.parts(template, {path: value}),)) != known:
                    raise TypeError("compiled code depends on the value")
                return 0

            try:
                jax.vmap(probe)(some)
                traceable[path] = True
            except UNTRACEABLE:
                traceable[path] = False
        return traceable

    def templates(self, values: Mapping[str, Any]) -> Templates:
        """Return the template of a case: its descriptions, and the scenario built from them.

        - `values`: the case's values by dotted path.
        """
        case = self.case(values)
        built = case.build("template")
        return Templates(case, case.as_it_is(), built)


@dataclass(frozen=True, eq=False)
class Templates:
    """A case of a family, in which `Family.parts` replaces values.

    - `believed`: description of the closed loop as the law knows it.
    - `actual`: description of the true closed loop.
    - `built`: the scenario that is built from both.
    """

    believed: ScenarioDescription
    actual: ScenarioDescription
    built: Scenario

    @property
    def controller(self) -> AbstractController:
        """The law."""
        return self.built.controller

    def with_engine(self, engine: str) -> Templates:
        """Return a copy with another engine: "auto", "native", "xla" or "cuda"."""
        return replace(self, built=self.built.replace(engine=engine))


def _space(base: ScenarioDescription, sets: Mapping[str, AbstractSet], *, law: bool) -> Space:
    """Return the space of sets, by full paths such as `scheme.surface.k1`; `law`: True if the law knows the values."""
    data = base.model_dump(exclude_unset=True, exclude={"truth", "uncertainty"})
    own = base if law else base.as_it_is()
    placed: dict[str, AbstractSet] = {}
    joints = _arm(own).joint_names
    for path, values in sets.items():
        with locate_errors(path):
            full = "start.q" if path == "start" and isinstance(values, InsideEnvelope) else path_in(data, path, joints)
        if isinstance(values, InsideEnvelope) and full != "start.q":
            raise DefinitionError("`inside` is only for the path `start`", where=path)
        if not law and full.split(".")[0] in OF_THE_LAW:
            raise DefinitionError(
                f"is a setting of the law or simulation, so its value is never unknown: {KNOWN_TO_LAW_REMEDY}",
                where=path,
            )
        if full in placed:
            raise DefinitionError("is the same value as that of another path; leave one of them out", where=path)
        placed[full] = values
    leaves: dict[str, Leaf] = {}
    for path, values in placed.items():
        with locate_errors(path):
            leaves[path] = _leaf(own, path, values, len(joints))
    return Space(leaves, placed)


def _leaf(own: ScenarioDescription, path: str, values: AbstractSet, joints: int) -> Leaf:
    """Return the value at a path; the set gives its shape if the file has no value."""
    example = values.example
    try:
        leaf = leaf_of(own, path, joints)
    except DefinitionError:
        if example is None:
            raise
        written = _written(own, path, example, joints)
        if written is None:
            raise
        leaf = written
    if leaf.own is None and example is not None:
        leaf = _written(own, path, example, joints) or leaf
    if leaf.per_joint and leaf.shape == () and np.ndim(example):
        # The file has a single number, the set one for each joint.
        leaf = replace(leaf, own=np.asarray(example, float))
    if isinstance(values, InertialBand):
        return replace(leaf, arm=lambda: own.robot.build().nominal)
    return replace(leaf, envelope=lambda: _start_of(own)) if isinstance(values, InsideEnvelope) else leaf


def _written(own: ScenarioDescription, path: str, example: Any, joints: int) -> Leaf | None:
    """Return the value at a path after the example is written there; None if the scenario is then invalid."""
    data = own.model_dump(exclude_unset=True, exclude={"truth", "uncertainty"})
    try:
        there = leaf_of(validate_text(data, {path: example}, form=type(own)), path, joints)
    except DefinitionError:
        return None
    return replace(there, own=np.asarray(example, float) if np.ndim(example) else None)


def _arm(base: ScenarioDescription) -> AbstractRobot:
    with locate_errors("robot"):
        arm: AbstractRobot = base.robot.build().true
    return arm


def _start_of(own: ScenarioDescription) -> tuple[Array, Array]:
    """Return lowest and highest positions at t = 0 inside the tolerance band, or inside the envelope without a band."""
    scenario = own.build("start")
    t = jax.numpy.zeros(())
    reference = scenario.trajectory.reference(t)
    state = State(q=reference.q, dq=reference.dq)
    envelope: Envelope | None
    if scenario.tolerance is not None:
        envelope = scenario.tolerance.envelope(t, scenario.tolerance.init(t, jax.numpy.zeros_like(reference.q)))
    else:
        envelope = scenario.controller.envelope(t, scenario.controller.init(t, state, reference))
    if envelope is None:
        raise DefinitionError("the scheme has no envelope: write `start.q: {around: 0.1}`")
    q = np.asarray(reference.q)
    return q + np.asarray(envelope.lower), q + np.asarray(envelope.upper)
