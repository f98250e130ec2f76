"""What is wrong with a built site: links that lead nowhere, and anything that is fetched from another host."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "object": "data"}
STYLE = re.compile(r"(?:url\(\s*|@import\s+)[\"']?(https?:)?//", re.IGNORECASE)


@dataclass
class _Page(HTMLParser):
    """The links, anchors and fetched files of a page."""

    links: list[str] = field(default_factory=list)
    anchors: set[str] = field(default_factory=set)
    fetched: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.anchors |= {value for key in ("id", "name") if (value := given.get(key))}
        if tag == "a" and (href := given.get("href")) is not None:
            self.links.append(href)
        if tag == "link" and "canonical" not in (given.get("rel") or "") and (href := given.get("href")):
            self.fetched.append(href)
        if tag in FETCHED and (source := given.get(FETCHED[tag])):
            self.fetched.append(source)


@dataclass
class Findings:
    """What a check of the site has found.

    - `broken`: what leads nowhere, with the page.
    - `foreign`: what is fetched from elsewhere, with the page.
    - `outward`: links that lead to other sites; they are listed and not followed.
    - `pages`: how many pages there are.
    """

    broken: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    outward: dict[str, str] = field(default_factory=dict)
    pages: int = 0


def checked(site: Path) -> Findings:
    """Looks at every page of a built site.

    - `site`: its folder.
    """
    site = site.resolve()
    read = {path: _read(path) for path in sorted(site.rglob("*.html")) if "playground" not in path.parts}
    found = Findings(pages=len(read))
    for path, page in read.items():
        name = path.relative_to(site).as_posix()
        for link in [*page.links, *page.fetched]:
            scheme = urlsplit(link).scheme
            if scheme in ("http", "https") or link.startswith("//"):
                if link in page.fetched:
                    found.foreign.append(f"{name}: {link}")
                else:
                    found.outward.setdefault(link, name)
            # The page of a missing page is served anywhere, so that its links begin at the root of the server.
            elif scheme not in ("data", "mailto", "javascript", "blob") and name != "404.html":
                said = _wrong(link, path, site, read)
                found.broken += [f"{name}: {link} ({said})"] if said else []
    for style in site.rglob("*.css"):
        if STYLE.search(style.read_text(encoding="utf-8")):
            found.foreign.append(f"{style.relative_to(site)}: a font or a style of another host")
    return found


def _read(path: Path) -> _Page:
    page = _Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def _wrong(link: str, path: Path, site: Path, read: dict[Path, _Page]) -> str:
    target, anchor = urldefrag(link)
    target = unquote(urlsplit(target).path)
    to = path if not target else Path(os.path.normpath(path.parent / target))
    if to.is_dir():
        to = to / "index.html"
    if site not in to.parents or not (to in read or to.exists()):
        return "there is no such page"
    page = read.get(to)
    if anchor and page is not None and unquote(anchor) not in page.anchors and not anchor.startswith(":~:"):
        return "there is no such place on it"
    return ""
