"""Access checks of the studio: host, token, request size."""

from __future__ import annotations

import ipaddress
import secrets
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN = "x-slidax-token"
"""Header with the token. A cookie would also be sent by pages on other ports."""

LARGEST, LARGEST_FILE = 2_000_000, 64_000_000
"""Largest request, and largest upload [bytes]."""

ALWAYS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "x-frame-options": "DENY",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}
"""Headers of every answer."""

NOTHING = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
"""Content security policy of answers that do not set their own."""


class Guard:
    """Refuses requests from other pages or machines, without the token, or of excessive size.

    - `app`: answers the other requests.
    - `port`, `token`: port and token of the server.
    """

    def __init__(self, app: ASGIApp, *, port: int, token: str) -> None:
        self._app, self._token = app, token.encode()
        self._hosts = {f"{host}:{port}" for host in ("127.0.0.1", "localhost", "[::1]")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return
        refused = self._refused(scope)
        if refused is not None:
            await JSONResponse({"error": {"where": "", "message": refused[1]}}, refused[0])(scope, receive, _with(send))
            return
        most = LARGEST_FILE if scope["method"] == "PUT" else LARGEST
        await self._app(scope, _counted(receive, most), _with(send))

    def _refused(self, scope: Scope) -> tuple[int, str] | None:
        headers = Headers(scope=scope)
        client = scope.get("client")
        if client is not None and not _loopback(client[0]):
            return 403, "the studio answers only this machine"
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return 403, "wrong address: open the one that the studio printed"
        origins = headers.getlist("origin")
        if origins and (len(origins) > 1 or origins[0] != f"http://{hosts[0].lower()}"):
            return 403, "the request comes from another page"
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            return 403, "the request comes from another page"
        path: str = scope["path"]
        if not path.startswith("/api/"):
            return None if scope["method"] in ("GET", "HEAD") else (405, "this address can only be read")
        if headers.get("sec-fetch-site") == "none":
            return 403, "only the studio's page may request this"
        tokens = headers.getlist(TOKEN)
        if len(tokens) != 1 or not secrets.compare_digest(tokens[0].encode("utf-8", "replace"), self._token):
            return 401, "no valid token: open the address that the studio printed"
        length = headers.get("content-length", "0")
        most = LARGEST_FILE if scope["method"] == "PUT" else LARGEST
        if not (length.isascii() and length.isdigit()) or len(length) > 18 or int(length) > most:
            return 413, f"a request may have at most {most} bytes"
        kind = headers.get("content-type", "").split(";")[0].strip().lower()
        if scope["method"] == "POST" and kind != "application/json":
            return 415, "a request must be JSON"
        return None


class TooLargeError(Exception):
    """The body of a request is too large."""


def _counted(receive: Receive, most: int) -> Receive:
    left = most

    async def counted() -> Message:
        nonlocal left
        message = await receive()
        left -= len(message.get("body", b""))
        if left < 0:
            raise TooLargeError
        return message

    return counted


def _with(send: Send) -> Send:
    async def complete(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(raw=message.setdefault("headers", []))
            for name, value in ALWAYS.items():
                headers.setdefault(name, value)
            headers.setdefault("content-security-policy", NOTHING)
        await send(message)

    return complete


def _loopback(host: Any) -> bool:
    try:
        return ipaddress.ip_address(str(host).split("%")[0]).is_loopback
    except ValueError:
        return False
