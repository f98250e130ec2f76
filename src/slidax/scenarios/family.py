"""Scenarios that differ in some numbers: what a study is about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np

from slidax._errors import DefinitionError, located
from slidax._types import Envelope, State
from slidax.controllers import AbstractController
from slidax.simulation import MujocoPlant, Parts

from .changes import path_in
from .description import OF_THE_LAW, TOLD, Moving, ScenarioDescription
from .load import validated
from .scenario import Scenario
from .uncertainty import AbstractSet, Leaf, Space, leaf_of, with_values
from .uncertainty.leaf import Array
from .uncertainty.sets import Inside
from .uncertainty.space import as_changes

UNTRACEABLE = (TypeError, ValueError, AttributeError, DefinitionError)
"""What Python raises where an array is used that is not known yet."""


@dataclass(frozen=True, eq=False)
class Family:
    """All scenarios that a file and sets of values allow.

    - `base`: the file's own.
    - `uncertain`: what is otherwise than the law is told.
    - `varied`: what the law is told, too, as by `--set`.
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
        """The family of a scenario.

        - `base`: the scenario.
        - `uncertain`: sets by path; those of the scenario if not given.
        - `varied`: sets of what the law is told, too.

        Raises DefinitionError if a path leads nowhere, a set is empty, or a value is out of its range.
        """
        resolved = base.model_copy(update={"robot": base.robot.resolved()})
        found = {}
        for where, sets in (
            ("uncertainty", base.uncertainty if uncertain is None else uncertain),
            ("varied", varied),
        ):
            with located(where):
                found[where] = _space(resolved, sets, law=where == "varied")
        both = [path for path in found["uncertainty"].sets if path in found["varied"].sets]
        if both:
            raise DefinitionError("is uncertain and varied at once; leave one out", where=f"uncertainty.{both[0]}")
        family = cls(resolved, found["uncertainty"], found["varied"])
        family.require_valid()
        return family

    @cached_property
    def space(self) -> Space:
        """Both spaces as one: what is uncertain first."""
        return Space({**self.uncertain.leaves, **self.varied.leaves}, {**self.uncertain.sets, **self.varied.sets})

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the robot's joints."""
        return _joints(self.base)

    def label(self, column: str) -> str:
        """A column of a study's table for a person: a joint by its name, any other place by its number from 0.

        - `column`: such as `start.q[3]`, or a path such as `start.q.3`.

        `--set` takes what it returns.
        """
        path, _, places = column.partition("[")
        leaf = self.space.leaves[path]
        if not places and path.rpartition(".")[2].isdigit():
            path, _, place = path.rpartition(".")
            return f"{path}[{self.joint_names[int(place)]}]" if leaf.one_of_joints else f"{path}[{place}]"
        if leaf.each_joint and places[:-1].isdigit():
            return f"{path}[{self.joint_names[int(places[:-1])]}]"
        return column

    def require_valid(self) -> None:
        """Raises DefinitionError, with the path, if a scenario at an end of the sets is invalid."""
        for where, space in (("uncertainty", self.uncertain), ("varied", self.varied)):
            with located(where):
                ends = space.ends() if space.sets else []
            for values in ends:
                try:
                    self._require_buildable(values, space)
                except DefinitionError as error:
                    raise self._blamed(where, space, values, error) from None

    def _require_buildable(self, values: Mapping[str, Any], space: Space) -> None:
        case = self.case(values)
        if space is self.varied:
            case.build("end")
        else:
            case.as_it_is().moving()

    def _blamed(self, where: str, space: Space, values: Mapping[str, Any], error: DefinitionError) -> DefinitionError:
        """The same mistake with the path of the set that makes it by itself, if one does."""
        for path, value in values.items():
            try:
                self._require_buildable({path: value}, space)
            except DefinitionError as found:
                return DefinitionError(found.message, where=f"{where}.{path}")
        return DefinitionError(f"some of its values do not go together: {error}", where=where)

    def case(self, values: Mapping[str, Any]) -> ScenarioDescription:
        """The scenario with these values, which a file can hold.

        - `values`: by path; what is not given is the scenario's own.

        Raises DefinitionError if one is invalid.
        """
        given = as_changes(values)
        told = {path: value for path, value in given.items() if path in self.varied.sets}
        true = {path: value for path, value in given.items() if path in self.uncertain.sets}
        data = self.base.model_dump(exclude_unset=True, exclude={"uncertainty"})
        data["truth"] = {**self.base.truth, **true}
        return validated(data, told, form=type(self.base))

    def scenario(self, values: Mapping[str, Any], name: str) -> Scenario:
        """The same, built.

        - `values`: as in `case`.
        - `name`: what to call it.
        """
        return self.case(values).build(name)

    def parts(self, template: Templates, values: Mapping[str, Any]) -> Parts:
        """The parts of the loop with these values, which may be traced and are not checked.

        - `template`: has all other values.
        - `values`: by path.
        """
        told = {path: value for path, value in values.items() if path in self.varied.sets}
        controller = template.controller
        if told:
            believed = with_values(template.believed, told)
            controller = believed.law(believed.moving())
        actual: Moving = with_values(template.actual, values).moving()
        if isinstance(actual.plant, MujocoPlant):
            raise DefinitionError("MuJoCo moves one arm at a time")
        parts = actual.plant, controller, actual.trajectory, actual.state0
        tolerance = template.built.tolerance
        return parts if tolerance is None else (*parts, tolerance)

    def traceable(self, template: Templates, values: Mapping[str, Array]) -> dict[str, bool]:
        """Which paths lead to arrays of the loop, so that many values of them go through one compiled loop.

        - `template`: of one case.
        - `values`: some of each path, with the row first.
        """
        known: Any = jax.tree.structure((self.parts(template, {}),))
        found = {}
        for path, some in values.items():

            def probe(value: Any, path: str = path) -> Any:
                made = jax.tree.structure((self.parts(template, {path: value}),))
                if made != known:
                    raise TypeError("what is compiled depends on it")
                return 0

            try:
                jax.vmap(probe)(some)
                found[path] = True
            except UNTRACEABLE:
                found[path] = False
        return found

    def templates(self, values: Mapping[str, Any]) -> Templates:
        """A case in which every path leads somewhere.

        - `values`: of all paths, of one case.
        """
        case = self.case(values)
        built = case.build("template")
        return Templates(case, case.as_it_is(), built)


@dataclass(frozen=True, eq=False)
class Templates:
    """One case of a family.

    - `believed`: as the law is told.
    - `actual`: as it is.
    - `built`: both.
    """

    believed: ScenarioDescription
    actual: ScenarioDescription
    built: Scenario

    @property
    def controller(self) -> AbstractController:
        """Its law."""
        return self.built.controller

    def with_engine(self, engine: str) -> Templates:
        """The same, run by another engine.

        - `engine`: as in `simulate`.
        """
        return replace(self, built=self.built.replace(engine=engine))


def _space(base: ScenarioDescription, sets: Mapping[str, AbstractSet], *, law: bool) -> Space:
    """The sets by the paths of their numbers, with the numbers."""
    data = base.model_dump(exclude_unset=True, exclude={"truth", "uncertainty"})
    own = base if law else base.as_it_is()
    placed: dict[str, AbstractSet] = {}
    joints = _joints(own)
    for path, one in sets.items():
        with located(path):
            full = "start.q" if path == "start" and isinstance(one, Inside) else path_in(data, path, joints)
        if isinstance(one, Inside) and full != "start.q":
            raise DefinitionError("`inside` is for `start`", where=path)
        if not law and full.split(".")[0] in OF_THE_LAW:
            raise DefinitionError(f"is what the law is told, or how time passes, not what is true: {TOLD}", where=path)
        if full in placed:
            raise DefinitionError("is given twice", where=path)
        placed[full] = one
    leaves: dict[str, Leaf] = {}
    for path, one in placed.items():
        with located(path):
            leaves[path] = _leaf(own, path, one, len(joints))
    return Space(leaves, placed)


def _leaf(own: ScenarioDescription, path: str, one: AbstractSet, joints: int) -> Leaf:
    """What the file does not have gets its form from the set."""
    example = one.example
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
        # One number in the file, and one for each joint in the set.
        leaf = replace(leaf, own=np.asarray(example, float))
    return replace(leaf, envelope=lambda: _start_of(own)) if isinstance(one, Inside) else leaf


def _written(own: ScenarioDescription, path: str, example: Any, joints: int) -> Leaf | None:
    """The number as it is once a value is written there; None if it cannot be."""
    data = own.model_dump(exclude_unset=True, exclude={"truth", "uncertainty"})
    try:
        there = leaf_of(validated(data, {path: example}, form=type(own)), path, joints)
    except DefinitionError:
        return None
    return replace(there, own=np.asarray(example, float) if np.ndim(example) else None)


def _joints(base: ScenarioDescription) -> tuple[str, ...]:
    with located("robot"):
        names: tuple[str, ...] = base.robot.build().true.joint_names
    return names


def _start_of(own: ScenarioDescription) -> tuple[Array, Array]:
    """The lowest and highest positions at t = 0 that are inside the envelope, or the tolerance band if there is one."""
    made = own.build("start")
    t = jax.numpy.zeros(())
    reference = made.trajectory.reference(t)
    state = State(q=reference.q, dq=reference.dq)
    envelope: Envelope | None
    if made.tolerance is not None:
        envelope = made.tolerance.envelope(t, made.tolerance.init(t, jax.numpy.zeros_like(reference.q)))
    else:
        envelope = made.controller.envelope(t, made.controller.init(t, state, reference))
    if envelope is None:
        raise DefinitionError("the scheme draws no envelope: write `start.q: {around: 0.1}`")
    q = np.asarray(reference.q)
    return q + np.asarray(envelope.lower), q + np.asarray(envelope.upper)
