"""How a test runs over every member of a room: each room keeps a list of (name, instance) in its `members.py`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest


def every(name: str, members: Sequence[tuple[str, Any]]) -> pytest.MarkDecorator:
    """Runs the test once per member.

    - `name`: the argument of the test that takes the member.
    - `members`: (name, instance) pairs.
    """
    return pytest.mark.parametrize(name, [pytest.param(instance, id=label) for label, instance in members])
