"""First scenario for an arm, as a commented file with the reason for each choice."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from os.path import relpath
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError, nearest
from slidax.robots import Articulated, Coupled, built_in_arm, built_in_names, from_mjcf, from_urdf
from slidax.robots.files.chain import Chain, chain_of

from .motion import motion_about
from .posture import home_of
from .ratings import ratings_of
from .text import Choices, draft_text

SLOWEST, FASTEST = 20.0, 20_000.0
"""Hz: allowed loop rates."""

FILES = {".urdf": "urdf", ".xacro": "urdf", ".xml": "mjcf", ".mjcf": "mjcf"}


@dataclass(frozen=True)
class Drafted:
    """A new scenario.

    - `text`: content of the file.
    - `notes`: assumptions, each a sentence.
    """

    text: str
    notes: tuple[str, ...]


def draft(robot: str | Path, rate: float = 1000.0, *, tip: str | None = None, folder: Path = Path()) -> Drafted:
    """Return a scenario for an arm that runs, with comments for a person who will edit it.

    - `robot`: a built-in arm by name, or the path of a URDF or MJCF file.
    - `rate`: loop rate, Hz.
    - `tip`: link, body or site at the end of the arm; None to search it.
    - `folder`: folder of the scenario file, from which it names the robot file.

    Raises DefinitionError if the robot does not exist, the file is not one arm, or the rate is out of its range.
    """
    if not (math.isfinite(rate) and SLOWEST <= rate <= FASTEST):
        raise DefinitionError(f"the rate must be {SLOWEST:g} to {FASTEST:g} Hz; got {rate:g}")
    arm, block, notes = _arm(str(robot), tip, folder)
    ratings = ratings_of(arm)
    home = home_of(arm, ratings)
    motion = motion_about(arm, ratings, home)
    notes = (*notes, *ratings.notes)
    return Drafted(draft_text(Choices(arm, block, rate, ratings, home, motion, notes)), notes)


def _arm(robot: str, tip: str | None, folder: Path) -> tuple[Articulated, dict[str, Any], tuple[str, ...]]:
    """The arm, the scenario's `robot`, and notes about it."""
    if robot in built_in_names():
        if tip is not None:
            raise DefinitionError(f"`{robot}` has its tip; `tip` is for robot files")
        return built_in_arm(robot).robot, {"kind": robot}, ()
    path = Path(robot)
    kind = FILES.get(path.suffix.lower())
    if kind is None:
        known = ", ".join(FILES)
        raise DefinitionError(
            f"`{robot}` is neither a built-in arm nor a file ({known}); {nearest(robot, built_in_names())}"
        )
    chain = chain_of(path, tip)
    read = from_urdf if kind == "urdf" else from_mjcf
    with warnings.catch_warnings(record=True) as assumed:
        warnings.simplefilter("always")
        arm = read(path, tip=chain.tip, locked=chain.locked, inertias="nearest")
    if isinstance(arm, Coupled):
        raise DefinitionError(_with_followers(arm, kind, path, chain.tip))
    messages = [str(warning.message).removeprefix(f"{path}: ") for warning in assumed]
    changed = [message for message in messages if "inertias are changed" in message]
    notes = [message.rpartition("; ")[2] for message in changed]
    notes += [message for message in messages if message.endswith("left out")]
    block: dict[str, Any] = {"kind": kind, "file": relpath(path, folder), "tip": chain.tip}
    if chain.locked:
        block["locked"] = {name: float(f"{value:.6g}") for name, value in chain.locked.items()}
        notes.append(_held(chain))
    if changed:
        block["inertias"] = "nearest"
    return arm, block, tuple(notes)


def _with_followers(arm: Coupled, kind: str, path: Path, tip: str) -> str:
    """The message for an arm whose joints follow others, with the remedy."""
    follower = arm.followers[0]
    carrier = arm.arm.parents[arm.arm.joint_names.index(follower)]
    link = arm.arm.link_names[carrier]
    shorter = f"`--tip {link}` ends the arm before this joint and holds it; or " if carrier >= 0 else ""
    return (
        f"joint `{follower}` of `{path}` follows another joint, and `slidax new` chooses no motion for such an arm; "
        f"{shorter}write the scenario by hand with `robot: {{kind: {kind}, file: {path.name}, tip: {tip}}}`"
    )


def _held(chain: Chain) -> str:
    where = "held where each is" if len(chain.locked) > 1 else "held where it is"
    return f"{', '.join(chain.locked)}: not of the arm, whose tip is `{chain.tip}`; {where} nearest to 0"
