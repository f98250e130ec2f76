"""The pages of the documentation, and what stands in their blocks."""

from __future__ import annotations

from pathlib import Path

from scripts.documentation.pages import Block, blocks

ROOT = Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [*DOCS, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
TERMINAL = ("console", "sh")
CODE = ("python", "py", *TERMINAL)


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def of(page: Path) -> list[Block]:
    return blocks(page.read_text(encoding="utf-8"))
