"""Lays the pages of the site out in one folder: those of docs/, those that lie elsewhere, and the files they name."""

from __future__ import annotations

import html
import os
import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
ELSEWHERE = {
    "benchmarks/PERFORMANCE.md": "benchmarks.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Pages that lie outside of docs/, by where they are on the site."""

LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^()\s]+)(\s+\"[^\"]*\")?\)")
CODE = re.compile(r"(^ *```.*?^ *```|`[^`\n]*`|^    [^\n]*$)", re.DOTALL | re.MULTILINE)
SCHEME = re.compile(r"[a-z]+:")


@dataclass
class Stage:
    """The folder from which the site is built.

    - `folder`: where pages go.
    - `files`: what pages link to outside of docs/, by path in the repository.
    - `pages`: the pages that were laid out, by their place on the site.
    - `made`: files that were made for the site, by their place on it.
    """

    folder: Path
    files: set[str] = field(default_factory=set)
    pages: dict[str, str] = field(default_factory=dict)
    made: dict[str, Path] = field(default_factory=dict)

    def lay_out(self) -> None:
        """Reads all pages, with their links as the site needs them."""
        for path in sorted((ROOT / "docs").rglob("*.md")):
            place = path.relative_to(ROOT / "docs").as_posix()
            if not place.startswith("api/"):
                self.pages[place] = self.linked(path.read_text(encoding="utf-8"), f"docs/{place}", place)
        for source, place in ELSEWHERE.items():
            if (ROOT / source).exists():
                self.pages[place] = self.linked((ROOT / source).read_text(encoding="utf-8"), source, place)

    def linked(self, text: str, source: str, place: str) -> str:
        """A page whose links lead to pages and files of the site.

        - `text`: of the page.
        - `source`: where it is in the repository.
        - `place`: where it will be on the site.
        """
        start = os.path.dirname(place)

        def one(match: re.Match[str]) -> str:
            label, target, title = match[1], match[2], match[3] or ""
            if SCHEME.match(target) or target.startswith("#"):
                return match[0]
            path, _, anchor = target.partition("#")
            inside = os.path.normpath(os.path.join(os.path.dirname(source), path))
            to = self.place_of(inside)
            joined = os.path.relpath(to, start or ".") + (f"#{anchor}" if anchor else "")
            # In the folder a page is known by its file, on the site by its title.
            if label == f"[{os.path.basename(path)}]" and path.endswith(".md"):
                label = f"[{_title(ROOT / inside)}]"
            return f"{label}({joined}{title})"

        parts = CODE.split(text)
        return "".join(part if k % 2 else LINK.sub(one, part) for k, part in enumerate(parts))

    def place_of(self, source: str) -> str:
        """Where a file of the repository is on the site.

        - `source`: its path.
        """
        if source in ELSEWHERE:
            return ELSEWHERE[source]
        if source == "README.md":
            return "index.md"
        if source.startswith("docs/"):
            return source.removeprefix("docs/")
        self.files.add(source)
        return f"files/{source}/index.md" if (ROOT / source).is_dir() else f"files/{source}.md"

    def write(self) -> None:
        """Writes pages, figures and files down."""
        if self.folder.exists():
            shutil.rmtree(self.folder)
        for place, text in self.pages.items():
            path = self.folder / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        for path in sorted((ROOT / "docs").rglob("*")):
            if path.is_file() and path.suffix not in (".md",) and "api" not in path.parts:
                to = self.folder / path.relative_to(ROOT / "docs")
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(path, to)
        for source in sorted(self.files):
            self._file(source)
        for place, path in self.made.items():
            to = self.folder / place
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, to)

    def _file(self, source: str) -> None:
        """A page that shows a file, or lists a folder."""
        path = ROOT / source
        if not path.exists():
            raise FileNotFoundError(f"a page links to `{source}`, which is not there")
        target = self.folder / self.place_of(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            inside = sorted(one for one in path.rglob("*") if one.is_file() and "__pycache__" not in one.parts)
            lines = [f"# `{source}`", ""]
            for one in inside:
                relative = one.relative_to(path).as_posix()
                lines.append(f"- [{relative}]({relative}.md)")
                self._shown(one, self.folder / "files" / f"{source}/{relative}.md")
            target.write_text("\n".join([*lines, ""]), encoding="utf-8")
        else:
            self._shown(path, target)

    def _shown(self, path: Path, target: Path) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        raw = target.with_suffix("")
        shutil.copy(path, raw)
        if path.suffix == ".md":
            shown = self.linked(text, name, target.relative_to(self.folder).as_posix())
            target.write_text(shown, encoding="utf-8")
            return
        language = {".py": "python", ".yaml": "yaml", ".urdf": "xml", ".xml": "xml"}.get(path.suffix, "text")
        body = f"# `{html.escape(name)}`\n\n[The file itself]({raw.name})\n\n````{language}\n{text}\n````\n"
        target.write_text(body, encoding="utf-8")


def _title(page: Path) -> str:
    """The title of a page, up to a colon.

    - `page`: its file.
    """
    first = page.read_text(encoding="utf-8").lstrip().partition("\n")[0].removeprefix("# ")
    return first.partition(":")[0].strip()
