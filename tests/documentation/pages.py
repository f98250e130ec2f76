"""The pages of the documentation, and their code blocks."""

from pathlib import Path

from scripts.documentation.pages import blocks

ROOT = Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [*DOCS, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
TERMINAL = ("console", "sh")
CODE = ("python", "py", *TERMINAL)


def name(page):
    return page.relative_to(ROOT).as_posix()


def of(page):
    return blocks(page.read_text(encoding="utf-8"))
