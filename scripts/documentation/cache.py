"""Runs the code of all pages, some at a time; a page of which nothing has changed is not run again."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from .blocks import blocks

ROOT = Path(__file__).parents[2]
STORE = ROOT / "build" / "pages"
RUNNER = "scripts/documentation/"
SOURCES = (
    "src/slidax",
    "examples",
    *(f"{RUNNER}{name}.py" for name in ("blocks", "commands", "page_run", "parts_of_files")),
)
PACKAGES = ("jax", "numpy", "scipy", "matplotlib", "llvmlite", "mujoco")


@dataclass
class Found:
    """What came of the code of a page.

    - `outcomes`: of its blocks, as `page_run.Outcome` has them.
    - `figures`: the files that they have made.
    """

    outcomes: list[dict[str, Any]] = field(default_factory=list)
    figures: list[Path] = field(default_factory=list)


def pages() -> list[str]:
    """The pages of docs/ with code, by their place there."""
    found = sorted((ROOT / "docs").rglob("*.md"))
    return [
        path.relative_to(ROOT / "docs").as_posix()
        for path in found
        if "api" not in path.parts and blocks(path.read_text(encoding="utf-8"))
    ]


def run_all(jobs: int, only: list[str] | None) -> tuple[dict[str, Found], list[str]]:
    """The outcomes by page, and the messages of pages that do not run.

    - `jobs`: how many are run at a time.
    - `only`: these pages; all if not given.
    """
    names = [name for name in pages() if only is None or name in only or Path(name).stem in only]
    found: dict[str, Found] = {}
    failed: list[str] = []
    with ThreadPoolExecutor(jobs) as pool:
        for name, result in zip(names, pool.map(_one, names), strict=True):
            if isinstance(result, str):
                failed.append(f"docs/{name}: {result}")
            else:
                found[name] = result
    return found, failed


def _one(name: str) -> Found | str:
    page = ROOT / "docs" / name
    # Pages of different folders may have one name.
    slug = name.removesuffix(".md").replace("/", ".")
    folder = STORE / f"{slug}-{_key(page)}"
    if not (folder / "outcomes.json").exists():
        started = time.perf_counter()
        for old in STORE.glob(f"{slug}-" + "?" * 16):
            shutil.rmtree(old)
        folder.mkdir(parents=True)
        done = subprocess.run(
            [sys.executable, "-X", "utf8", ROOT / "scripts" / "run-page", page, "--out", folder],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "PYTHONDONTWRITEBYTECODE": "1"},
        )
        if done.returncode:
            return done.stderr[-4000:]
        print(f"{name}: {time.perf_counter() - started:.0f} s", flush=True)
    outcomes = json.loads((folder / "outcomes.json").read_text(encoding="utf-8"))
    return Found(outcomes, [folder / figure for one in outcomes for figure in one["figures"]])


def _key(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    said = [(one.language, one.text, sorted(one.marks.items())) for one in blocks(text)]
    return hashlib.sha256(f"{said}{sources()}".encode()).hexdigest()[:16]


@cache
def sources() -> str:
    """One number for all that the code of a page calls."""
    digest = hashlib.sha256(sys.version.encode())
    for name in PACKAGES:
        try:
            digest.update(f"{name} {metadata.version(name)}".encode())
        except metadata.PackageNotFoundError:
            digest.update(f"no {name}".encode())
    for source in SOURCES:
        for path in sorted((ROOT / source).rglob("*")) or [ROOT / source]:
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(path.relative_to(ROOT).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()
