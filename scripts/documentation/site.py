"""The site as a whole: run, laid out, built, checked."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from . import links
from .cache import run_all
from .gallery import with_gallery
from .playground import with_playground
from .results import with_results
from .stage import ROOT, Stage

BUILD = ROOT / "build" / "site"
SITE = ROOT / "site"


class Failed(Exception):
    """The site could not be made."""


def make(tools: Path, *, jobs: int = 2, run_code: bool = True, only: list[str] | None = None) -> None:
    """Makes the site.

    - `tools`: the environment of the builder.
    - `jobs`: how many pages are run at a time.
    - `run_code`: whether the code of the pages is run, and what it prints is shown.
    - `only`: the pages whose code is run, and nothing else done.

    Raises Failed, with all that is wrong.
    """
    started = time.perf_counter()
    BUILD.mkdir(parents=True, exist_ok=True)
    outcomes, failed = run_all(jobs, only) if run_code or only is not None else ({}, [])
    if failed:
        raise Failed("code on a page does not run:\n\n" + "\n\n".join(failed))
    if only is not None:
        return
    stage = Stage(BUILD / "docs")
    stage.lay_out()
    for place, found in outcomes.items():
        stage.pages[place] = with_results(stage.pages[place], place, found)
        stage.made |= {f"{Path(place).parent}/made/{figure.name}": figure for figure in found.figures}
    with_gallery(stage, run_code)
    if run_code:
        with_playground(stage)
    _reference(stage)
    stage.write()
    _configure(stage)
    _build(tools)
    _check()
    _look(tools)
    print(f"{SITE / 'index.html'}: {time.perf_counter() - started:.0f} s")


def _reference(stage: Stage) -> None:
    """The pages that are made of declarations and docstrings, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", _REFERENCE], cwd=ROOT / "scripts", capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise Failed(f"the reference cannot be made:\n{done.stderr[-3000:]}")
    pages, facts = json.loads(done.stdout)
    stage.pages |= pages
    (BUILD / "facts.json").write_text(json.dumps(facts, ensure_ascii=False), encoding="utf-8")


_REFERENCE = """
import json, sys
import jax
jax.config.update("jax_enable_x64", True)
from documentation import api
pages, facts = api.pages()
pages["reference/parameters.md"] = api.parameters_page()
json.dump([pages, facts], sys.stdout)
"""


def _configure(stage: Stage) -> None:
    """Writes the configuration with all pages in its table of contents."""
    from ruamel.yaml import YAML

    yaml = YAML()
    settings = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    listed = set(named(settings["nav"]))
    missing = sorted(listed - set(stage.pages))
    if missing:
        raise Failed(f"mkdocs.yml names pages that are not there: {', '.join(missing)}")
    reference = next(part for part in settings["nav"] if "Reference" in part)["Reference"]
    api = sorted(name for name in stage.pages if name.startswith("api/") and name != "api/index.md")
    reference.append({"API": ["api/index.md", *api]})
    rest = sorted(set(stage.pages) - listed - {name for name in stage.pages if name.startswith("api/")})
    if rest:
        print(f"pages that mkdocs.yml does not name, under More: {', '.join(rest)}")
        settings["nav"].append({"More": rest})
    settings["docs_dir"], settings["site_dir"] = "docs", "made"
    python = next(one["mkdocstrings"] for one in settings["plugins"] if "mkdocstrings" in one)["handlers"]["python"]
    python["paths"] = [str(ROOT / "src")]
    python["options"]["extensions"] = [
        {f"{ROOT / 'scripts' / 'documentation' / 'griffe_facts.py'}:Facts": {"path": str(BUILD / "facts.json")}}
    ]
    with (BUILD / "mkdocs.yml").open("w", encoding="utf-8") as file:
        yaml.dump(settings, file)


def named(nav: list[object] | str) -> list[str]:
    """The pages of a table of contents, in order.

    - `nav`: as mkdocs.yml has it.
    """
    if isinstance(nav, str):
        return [nav]
    return [name for part in nav for name in (named(next(iter(part.values()))) if isinstance(part, dict) else [part])]


def _build(tools: Path) -> None:
    program = tools / "bin" / "zensical"
    if not program.exists():
        raise Failed(f"there is no {program}: `make docs` makes that environment")
    subprocess.run([tools / "bin" / "python", Path(__file__).with_name("formulas.py"), BUILD / "docs"], check=True)
    shutil.rmtree(SITE, ignore_errors=True)
    done = subprocess.run(
        [program, "build", "--strict", "--clean", "--config-file", BUILD / "mkdocs.yml"],
        cwd=BUILD,
        env=os.environ | {"NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    said = (done.stdout + done.stderr).strip()
    if done.returncode or "arning" in said:
        raise Failed(f"the builder warns, or failed:\n{said[-6000:]}")
    # The builder writes below its configuration only.
    shutil.move(BUILD / "made", SITE)


def _check() -> None:
    found = links.checked(SITE)
    wrong = [
        *(f"leads nowhere: {one}" for one in found.broken),
        *(f"fetched from elsewhere: {one}" for one in found.foreign),
    ]
    if wrong:
        raise Failed(f"{len(wrong)} wrong links:\n" + "\n".join(wrong[:60]))
    listed = "\n".join(f"{link}  {page}" for link, page in sorted(found.outward.items()))
    (BUILD / "outward-links.txt").write_text(f"{listed}\n", encoding="utf-8")
    print(f"{found.pages} pages; {len(found.outward)} links to other sites, listed in {BUILD / 'outward-links.txt'}")


def _look(tools: Path) -> None:
    """Opens every page in a browser, where there is one."""
    done = subprocess.run(
        [tools / "bin" / "python", Path(__file__).with_name("browser.py"), SITE],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        raise Failed(f"pages are wrong in a browser:\n{done.stdout[-4000:]}")
    print(done.stdout.strip())
