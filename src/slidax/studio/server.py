"""The studio's server, for browsers on this machine only: connections, start and stop."""

from __future__ import annotations

import asyncio
import secrets
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from slidax.core.errors import DefinitionError

from .app import Studio
from .files import Folder
from .guard import TOKEN

HEAD, BODY = 10.0, 60.0
"""Time limits for the head of a request and for the whole request [s]."""

UNTRUSTED = 30.0
"""Time limit for a connection to send the token, except while an answer is computed [s]."""

MOST_UNTRUSTED = 40
"""Largest number of connections that have not sent the token; above it, the oldest one is closed."""

LOOK = 0.5
"""Interval between checks of a connection's time limits [s]."""


class Connection(H11Protocol):
    """A connection with time limits; a subclass sets the server's `token`."""

    token: ClassVar[bytes] = b""
    untrusted: ClassVar[dict[Connection, None]] = {}

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._made = self._begun = self.loop.time()
        self._arriving = True
        self._trusted = False
        self._watch = self.loop.call_later(LOOK, self._look)
        self.untrusted[self] = None
        if len(self.untrusted) > MOST_UNTRUSTED:
            next(iter(self.untrusted))._drop()

    def connection_lost(self, exc: Exception | None) -> None:
        self._watch.cancel()
        self.untrusted.pop(self, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if not self._arriving:
            self._arriving, self._begun = True, self.loop.time()
        super().data_received(data)
        self._note()

    def _note(self) -> None:
        """Update the progress of the request, and trust the connection once a request has the token."""
        self._arriving = self._arriving and self.conn.their_state in (h11.IDLE, h11.SEND_BODY)
        if not self._trusted and self.cycle is not None and _has_token(self.cycle.scope, self.token):
            self._trusted = True
            self.untrusted.pop(self, None)

    def _look(self) -> None:
        if self.transport.is_closing():
            return
        self._note()
        now = self.loop.time()
        limit = HEAD if self.conn.their_state is h11.IDLE else BODY
        pending = self.cycle is not None and not self.cycle.response_started
        if (self._arriving and now - self._begun > limit) or (
            not self._trusted and not pending and now - self._made > UNTRUSTED
        ):
            self._drop()
            return
        self._watch = self.loop.call_later(LOOK, self._look)

    def _drop(self) -> None:
        self.untrusted.pop(self, None)
        self.transport.abort()


def connections(token: str) -> type[Connection]:
    """Return the connection class of a server with this `token`."""
    return type("OwnConnection", (Connection,), {"token": token.encode(), "untrusted": {}})


def _has_token(scope: Any, token: bytes) -> bool:
    tokens = [value for name, value in scope["headers"] if name == TOKEN.encode()]
    return len(tokens) == 1 and secrets.compare_digest(tokens[0], token)


PORT = 8577
"""Default port; if it is in use, the server takes a free port."""


def serve(
    root: Path,
    *,
    module: str,
    opened: str = "",
    port: int | None = None,
    browser: bool = True,
    say: Callable[[str], None] = print,
) -> None:
    """Serve the studio to browsers on this machine until Ctrl-C, which also ends the studio's processes.

    - `root`: folder to read and write.
    - `module`: module of the command line; a job calls its `main`.
    - `opened`: first scenario of the page: a built-in one, or a file below the folder.
    - `port`: 0 for any free port; None for the default port, or a free one if it is in use.
    - `browser`: True to open a browser.
    - `say`: prints the address.

    Raises DefinitionError if the folder does not exist, or the port is in use.
    """
    folder = Folder(root)
    sockets = _sockets(port)
    number = int(sockets[0].getsockname()[1])
    token = secrets.token_urlsafe(32)
    studio = Studio(folder, module=module, opened=opened)
    address = f"http://127.0.0.1:{number}/#token={token}"
    config = uvicorn.Config(
        studio.app(port=number, token=token),
        # There is no proxy, so headers about another sender of a request are ignored.
        proxy_headers=False,
        server_header=False,
        access_log=False,
        log_level="warning",
        ws="none",
        http=connections(token),
        lifespan="on",
        limit_concurrency=100,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=2,
    )
    server = _Server(config, studio)

    def begin() -> None:
        say(f"The studio runs until Ctrl-C, and reads and writes only {folder.root}:\n{address}")
        if browser:
            webbrowser.open(address)

    with suppress(KeyboardInterrupt):
        asyncio.run(_run_server(server, sockets, begin))


class _Server(uvicorn.Server):
    """Ends the studio's processes before it waits for pending answers."""

    def __init__(self, config: uvicorn.Config, studio: Studio) -> None:
        super().__init__(config)
        self._studio = studio

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        await self._studio.close()
        await super().shutdown(sockets)


async def _run_server(server: uvicorn.Server, sockets: list[socket.socket], begin: Callable[[], None]) -> None:
    # Closing the terminal ends the server like Ctrl-C, so that its processes end.
    if sys.platform != "win32":
        asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, setattr, server, "should_exit", True)
    task = asyncio.create_task(server.serve(sockets))
    while not (server.started or task.done()):
        await asyncio.sleep(0.02)
    if server.started:
        begin()
    await task


def _sockets(port: int | None) -> list[socket.socket]:
    """Return loopback sockets at the same port for IPv4 and, if available, IPv6."""
    try:
        first = _listening(socket.AF_INET, "127.0.0.1", PORT if port is None else port)
    except OSError as error:
        if port is not None:
            raise DefinitionError(
                f"port {port} cannot be used: {error.strerror}; use --port 0 for a free one"
            ) from None
        first = _listening(socket.AF_INET, "127.0.0.1", 0)
    sockets = [first]
    # Another program on this IPv6 port would be taken for the studio: occupy it where IPv6 exists.
    with suppress(OSError):
        sockets.append(_listening(socket.AF_INET6, "::1", int(first.getsockname()[1])))
    return sockets


def _listening(family: int, host: str, port: int) -> socket.socket:
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if family == socket.AF_INET6:
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(128)
    except OSError:
        listener.close()
        raise
    return listener
