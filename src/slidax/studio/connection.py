"""Connections that are closed when they hold the server up: no request takes for ever to arrive.

A connection is trusted as soon as a request on it has said the token. Of the others only the newest stay when there
are many, so that a program without the token cannot take the place of the page.
"""

from __future__ import annotations

import secrets
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from .guard import TOKEN

HEAD, BODY = 10.0, 60.0
"""Seconds in which the head of a request, and all of it, must have arrived."""

UNTRUSTED = 30.0
"""Seconds in which a connection must have said the token, unless its answer is still being computed."""

MOST_UNTRUSTED = 40
"""Connections that have not said the token; the oldest is closed for a new one."""

LOOK = 0.5
"""Seconds between two looks at a connection."""


class Connection(H11Protocol):
    """A connection with limits; a subclass has the token of its server in `token`."""

    token: ClassVar[bytes] = b""
    untrusted: ClassVar[dict[Connection, None]] = {}

    def connection_made(self, transport: Any) -> None:
        """Begin to watch a connection.

        - `transport`: of it.
        """
        super().connection_made(transport)
        self._made = self._begun = self.loop.time()
        self._arriving = True
        self._trusted = False
        self._watch = self.loop.call_later(LOOK, self._look)
        self.untrusted[self] = None
        if len(self.untrusted) > MOST_UNTRUSTED:
            next(iter(self.untrusted))._drop()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection.

        - `exc`: why it ended; None if it was closed.
        """
        self._watch.cancel()
        self.untrusted.pop(self, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take bytes of a request.

        - `data`: the bytes.
        """
        if not self._arriving:
            self._arriving, self._begun = True, self.loop.time()
        super().data_received(data)
        self._note()

    def _note(self) -> None:
        """Note how far a request has come, and whether it said the token."""
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
    """The connections of one server.

    - `token`: that its page says.
    """
    return type("OwnConnection", (Connection,), {"token": token.encode(), "untrusted": {}})


def _says(scope: Any, token: bytes) -> bool:
    tokens = [value for name, value in scope["headers"] if name == TOKEN.encode()]
    return len(tokens) == 1 and secrets.compare_digest(tokens[0], token)
