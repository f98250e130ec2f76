"""Connections with time limits, so that no request blocks the server.

A connection is trusted once a request on it had the token. Only the newest untrusted connections are kept, so that a
program without the token cannot displace the page.
"""

from __future__ import annotations

import secrets
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from .guard import TOKEN

HEAD, BODY = 10.0, 60.0
"""Time limits for the head of a request and for all of it [s]."""

UNTRUSTED = 30.0
"""Time limit for sending the token, unless an answer is being computed [s]."""

MOST_UNTRUSTED = 40
"""Untrusted connections; the oldest is closed for a new one."""

LOOK = 0.5
"""Time between two checks of a connection [s]."""


class Connection(H11Protocol):
    """A connection with time limits; a subclass has the server's token in `token`."""

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
        """Note the progress of a request, and whether it has the token."""
        self._arriving = self._arriving and self.conn.their_state in (h11.IDLE, h11.SEND_BODY)
        if not self._trusted and self.cycle is not None and _says(self.cycle.scope, self.token):
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
    """The connection class of a server with a `token`."""
    return type("OwnConnection", (Connection,), {"token": token.encode(), "untrusted": {}})


def _says(scope: Any, token: bytes) -> bool:
    tokens = [value for name, value in scope["headers"] if name == TOKEN.encode()]
    return len(tokens) == 1 and secrets.compare_digest(tokens[0], token)
