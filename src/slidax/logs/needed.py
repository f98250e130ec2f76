"""Optional packages for logs, imported on first use."""

from __future__ import annotations

from typing import Any

REMEDY = "pip install 'slidax[log]'"


def require_writer() -> Any:
    """Return the package that writes MCAP files and serves live data.

    Raises DefinitionError with the remedy if it is not installed.
    """
    try:
        import foxglove
    except ImportError:
        from slidax._errors import DefinitionError

        raise DefinitionError(f"writing MCAP needs foxglove-sdk, which is not installed: {REMEDY}") from None
    return foxglove


def require_reader() -> None:
    """Raise DefinitionError with the remedy if the package that reads MCAP files is not installed."""
    try:
        import mcap.stream_reader  # noqa: F401  (only whether it is there)
    except ImportError:
        from slidax._errors import DefinitionError

        raise DefinitionError(f"reading MCAP needs mcap, which is not installed: {REMEDY}") from None


def require_rosbags() -> Any:
    """Return the reader of ros2 bag's databases.

    Raises DefinitionError with the remedy if its package is not installed.
    """
    try:
        from rosbags.rosbag2 import Reader
    except ImportError:
        from slidax._errors import DefinitionError

        raise DefinitionError(
            f"reading databases of ros2 bag needs rosbags, which is not installed: {REMEDY}"
        ) from None
    return Reader
