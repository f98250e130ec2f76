"""How a test runs over every member of a room: each room keeps a list of (name, instance) in its `members.py`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest


def every(
    name: str, members: Sequence[tuple[str, Any]], full: Sequence[str] = (), scope: str | None = None
) -> pytest.MarkDecorator:
    """Runs the test once per member.

    - `name`: the argument of the test that takes the member.
    - `members`: (name, instance) pairs.
    - `full`: names of members that are for the long version alone.
    - `scope`: "module" keeps the tests of a member together, so that a fixture of that scope serves all of them.
    """
    parameters = [
        pytest.param(instance, id=label, marks=[pytest.mark.full] if label in full else [])
        for label, instance in members
    ]
    return pytest.mark.parametrize(name, parameters, scope=scope)
