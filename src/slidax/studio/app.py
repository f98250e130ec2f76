"""The routes of the studio: page, files, workbench, jobs and results."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import shutil
import struct
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from html.parser import HTMLParser
from importlib import resources
from typing import Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from slidax.core.errors import DefinitionError
from slidax.core.files import json_value
from slidax.export.web.playground import PAGE, page_text

from .files import Folder, OutsideError, mark_of
from .guard import LARGEST_FILE, Guard, TooLargeError
from .jobs import Jobs, TooManyError
from .processes import OvertakenError, Workbench, scratch
from .requests import QUESTIONS, JobRequest, RequestError, read_request

FOLDER = resources.files("slidax.studio") / "page"

SCRIPTS = ("api.js", "scenario.js", "job-card.js", "jobs.js", "files.js", "studio.js")
"""Scripts of the page; each uses the previous ones."""

POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; connect-src 'self'; "
    "worker-src blob:; img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def page(manifest: Mapping[str, Any]) -> tuple[str, str]:
    """Return the HTML page for a `manifest` (see `manifest.py`), and the page's content security policy.

    The policy allows only the page's own scripts, and requests only to the studio.
    """
    nonce = secrets.token_urlsafe(18)
    text = page_text(
        manifest,
        scripts=[_source(name) for name in SCRIPTS],
        styles=[_source("studio.css")],
        policy=None,
        loop=None if _has_loop() else "export async function openProgram() { throw new Error('none'); }",
    )
    return _with_nonce(text, nonce), POLICY.format(nonce=nonce)


def _has_loop() -> bool:
    return (PAGE / "loop.js").is_file()


def _source(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


class _Scripts(HTMLParser):
    """Finds the positions of script elements in a page; text inside scripts is not searched."""

    def __init__(self) -> None:
        super().__init__()
        self.positions: list[tuple[int, int]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.positions.append(self.getpos())


def _with_nonce(text: str, nonce: str) -> str:
    scripts = _Scripts()
    scripts.feed(text)
    lines = text.split("\n")
    for line, column in reversed(scripts.positions):
        text = lines[line - 1]
        lines[line - 1] = text[:column] + re.sub("^<script", f'<script nonce="{nonce}"', text[column:])
    return "\n".join(lines)


DEFAULT = "example-4.1-1khz"
"""Scenario that the page shows until it has sent the token."""

COMPILING = 600.0
"""Time limit for compiling a scenario for the page [s]."""

SHOWN = 1_000_000
"""Largest file that is shown as text [bytes]."""

KINDS = {
    ".html": "text/html",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".json": "application/json",
}
"""Content types of results by ending; other files are plain text or downloads."""

PLAIN = (".yaml", ".yml", ".csv", ".md", ".c", ".h", ".txt", ".jsonl", ".urdf", ".xml", ".mjcf")

SANDBOX = "sandbox allow-scripts allow-downloads; default-src 'none'; style-src 'unsafe-inline'; "
SANDBOX += "script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; img-src 'self' data: blob:; "
SANDBOX += "font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""Security policy of reports: they run without an origin, and so cannot send requests to the studio."""


class JsonAnswer(JSONResponse):
    """Values as JSON; non-finite numbers become null, and incomplete surrogate pairs are escaped."""

    def render(self, content: Any) -> bytes:
        try:
            return json.dumps(content, allow_nan=False, separators=(",", ":")).encode("ascii")
        except ValueError:
            return json.dumps(json_value(content), allow_nan=False, separators=(",", ":")).encode("ascii")


Handler = Callable[[Request], Awaitable[Response]]


class Studio:
    """The application.

    - `folder`: the folder to read and write.
    - `module`: module of the command line; a job calls its `main`.
    - `opened`: first scenario of the page: a built-in one, or a file below the folder.
    """

    def __init__(self, folder: Folder, *, module: str, opened: str) -> None:
        self.folder, self.opened = folder, opened
        self._private = scratch()
        self.bench = Workbench(folder, self._private / "bench")
        # A second process, so that the sliders need not wait for a compilation.
        self.compiler = Workbench(folder, self._private / "compiler", longest=COMPILING)
        self._module = module
        self._manifest: dict[str, Any] | None = None
        self.jobs: Jobs

    def app(self, *, port: int, token: str) -> Starlette:
        """Return the Starlette application for a server at `port`, whose page sends the `token`."""
        routes = [
            Route("/", self._checked(self._page), methods=["GET"]),
            Route("/results/{key}/{name:path}", self._checked(self._results), methods=["GET"]),
            Route("/api/about", self._checked(self._about), methods=["GET"]),
            Route("/api/files", self._checked(self._files), methods=["GET"]),
            Route("/api/file", self._checked(self._file), methods=["GET"]),
            Route("/api/file", self._checked(self._save), methods=["PUT"]),
            Route("/api/jobs", self._checked(self._all_jobs), methods=["GET"]),
            Route("/api/jobs", self._checked(self._new_job), methods=["POST"]),
            Route("/api/jobs/{name}", self._checked(self._job), methods=["GET"]),
            Route("/api/jobs/{name}", self._checked(self._end_job), methods=["DELETE"]),
            Route("/api/{do}", self._checked(self._ask), methods=["POST"]),
        ]
        guard = Middleware(Guard, port=port, token=token)
        return Starlette(routes=routes, middleware=[guard], lifespan=self._life)

    @asynccontextmanager
    async def _life(self, _: Starlette) -> AsyncIterator[None]:
        self.jobs = Jobs(self.folder, self._private, self._module)
        await self.bench.warm()
        try:
            yield
        finally:
            await self.close()
            shutil.rmtree(self._private, ignore_errors=True)

    async def close(self) -> None:
        """End all processes; pending requests get an error."""
        await asyncio.gather(self.jobs.close(), self.bench.close(), self.compiler.close())

    def _checked(self, answer: Handler) -> Handler:
        """Return a handler that answers an exception by its message, with an HTTP status."""

        async def checked(request: Request) -> Response:
            try:
                return await answer(request)
            except OutsideError as error:
                return _error(403, error)
            except OvertakenError as error:
                return _error(409, error)
            except RequestError as error:
                return _error(400, error)
            except TooManyError as error:
                return _error(429, error)
            except DefinitionError as error:
                return _error(422, error)
            except FileExistsError as error:
                return JsonAnswer({"error": {"where": "", "message": str(error)}, "exists": True}, 409)
            except LookupError:
                return JsonAnswer({"error": {"where": "", "message": "not found"}}, 404)
            except (TooLargeError, ClientDisconnect):
                return JsonAnswer({"error": {"where": "", "message": "the request is too large"}}, 413)

        return checked

    async def _page(self, request: Request) -> Response:
        text, policy = page(await self._first())
        return Response(text, headers={"content-security-policy": policy}, media_type="text/html")

    async def _first(self) -> dict[str, Any]:
        """Return the manifest of a built-in scenario, which needs no token; the page requests others with the token."""
        if self._manifest is None:
            answer, _ = await self.bench.ask({"name": DEFAULT, "do": "manifest"})
            if "manifest" not in answer:
                raise DefinitionError(answer["error"]["message"])
            self._manifest = answer["manifest"]
        return self._manifest

    async def _about(self, request: Request) -> Response:
        import slidax

        from .jobs import COMMANDS

        return JsonAnswer(
            {
                "version": slidax.__version__,
                "folder": self.folder.root.name,
                "opened": self.opened,
                "shown": DEFAULT,
                "jobs": {name: list(readers) for name, (_, readers, _) in COMMANDS.items()},
                "restarts": self.bench.restarts,
            }
        )

    async def _files(self, request: Request) -> Response:
        entries = [
            {"name": entry.name, "size": entry.size, "changed": entry.changed} for entry in self.folder.listing()
        ]
        return JsonAnswer({"files": entries})

    async def _file(self, request: Request) -> Response:
        name = request.query_params.get("path", "")
        content = self.folder.read(name, SHOWN)
        text = content.decode("utf-8", "replace")
        return JsonAnswer({"path": name, "text": text, "mark": mark_of(content)})

    async def _save(self, request: Request) -> Response:
        name = request.query_params.get("path", "")
        before = request.headers.get("if-match")
        mark = self.folder.write(name, await _body(request), before or None)
        return JsonAnswer({"path": name, "mark": mark})

    async def _ask(self, request: Request) -> Response:
        do = request.path_params["do"]
        if do not in QUESTIONS:
            raise LookupError(do)
        question = read_request(await _body(request), QUESTIONS[do]).model_dump(exclude_none=True)
        who = str(request.headers.get("x-slidax-slot", ""))[:64]
        bench = self.compiler if do == "compiled" else self.bench
        answer, content = await bench.ask({**question, "do": do}, only_newest=who)
        if "error" in answer:
            outside = "outside the studio's folder" in answer["error"]["message"]
            return JsonAnswer(answer, 403 if outside else 422)
        if not content:
            return JsonAnswer(answer)
        head = bytes(JsonAnswer(answer).body)
        head += b" " * (-len(head) % 8)
        return Response(struct.pack("<Q", len(head)) + head + content, media_type="application/octet-stream")

    async def _all_jobs(self, request: Request) -> Response:
        return JsonAnswer({"jobs": self.jobs.all()})

    async def _new_job(self, request: Request) -> Response:
        new = read_request(await _body(request), JobRequest)
        job = self.jobs.add(new.kind, new.options)
        return JsonAnswer(self.jobs.shown(job), 201)

    async def _job(self, request: Request) -> Response:
        return JsonAnswer(self.jobs.shown(self.jobs.find(request.path_params["name"])))

    async def _end_job(self, request: Request) -> Response:
        job = self.jobs.find(request.path_params["name"])
        await self.jobs.cancel(job)
        return JsonAnswer(self.jobs.shown(job))

    async def _results(self, request: Request) -> Response:
        """Answer a request that has a job's key by a result file of this job, as a page without an origin."""
        job, name = self.jobs.of_key(request.path_params["key"]), request.path_params["name"]
        out = job.command.out
        if not out or not (name == out or name.startswith(f"{out}/")):
            raise LookupError(name)
        content = self.folder.read(name, LARGEST_FILE)
        ending = name[name.rfind(".") :].lower()
        kind = KINDS.get(ending, "text/plain" if ending in PLAIN else "application/octet-stream")
        # A page without an origin counts as another origin; the key is enough to load its files.
        headers = {"content-security-policy": SANDBOX, "cross-origin-resource-policy": "cross-origin"}
        return Response(content, media_type=kind, headers=headers)


async def _body(request: Request) -> bytes:
    return await request.body()


def _error(status: int, error: DefinitionError) -> Response:
    return JsonAnswer({"error": {"where": error.where, "message": error.message}}, status)
