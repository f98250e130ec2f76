"""What these tests need of a machine."""

from __future__ import annotations

import shutil

import pytest

needs_cmake = pytest.mark.skipif(
    shutil.which("cmake") is None or shutil.which("g++") is None, reason="cmake or g++ is not here"
)
