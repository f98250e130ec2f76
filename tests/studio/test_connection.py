import asyncio
import socket
import threading
import time

import pytest

pytest.importorskip("uvicorn", reason="the extra `studio` is not installed")

import uvicorn

from slidax.studio import server as connection
from slidax.studio.guard import Guard
from slidax.studio.server import connections

TOKEN = "right"


async def app(scope, receive, send):
    if scope["path"] == "/slow":
        await asyncio.sleep(1.5)
    size = 0
    while True:
        message = await receive()
        size += len(message.get("body", b""))
        if not message.get("more_body"):
            break
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"8000000")]})
    await send({"type": "http.response.body", "body": b"x" * 8_000_000})


@pytest.fixture
def port(monkeypatch):
    for name, value in {"HEAD": 0.4, "BODY": 0.8, "UNTRUSTED": 1.0, "LOOK": 0.05}.items():
        monkeypatch.setattr(connection, name, value)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(256)
        number = int(listening.getsockname()[1])
        guarded = Guard(app, port=number, token=TOKEN)
        config = uvicorn.Config(
            guarded, http=connections(TOKEN), ws="none", lifespan="off", log_level="critical", limit_concurrency=100
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([listening])), daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.01)
        yield number
        server.should_exit = True
        thread.join(10.0)


def opened(port, text):
    link = socket.create_connection(("127.0.0.1", port), timeout=10.0)
    link.sendall(text.format(host=f"127.0.0.1:{port}").replace("\n", "\r\n").encode())
    return link


def status(link):
    content = b""
    try:
        while len(content) < 8_000_000 and (more := link.recv(1 << 20)):
            content += more
            if b"content-length: 8000000" not in content[:2000] and b"\r\n\r\n" in content:
                break
    except ConnectionResetError:
        pass
    return int(content.split()[1]) if content else 0


GOOD = "GET /api/x HTTP/1.1\nhost: {host}\nx-slidax-token: right\n\n"


def is_closed(link, seconds):
    link.settimeout(seconds)
    try:
        while link.recv(1 << 20):
            pass
    except TimeoutError:
        return False
    except OSError:
        pass
    return True


def test_one_hundred_and_fifty_unfinished_requests_do_not_block_the_page(port):
    links = [opened(port, "GET /api/x HTTP/1.1\nhost: {host}\nx-a: ") for _ in range(150)]
    with opened(port, GOOD) as page:
        assert status(page) == 200
    assert all(is_closed(link, 5.0) for link in links)
    for link in links:
        link.close()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "GET",
        "GET / HTTP/1.1\nhost: {host}\n",
        "POST /api/x HTTP/1.1\nhost: {host}\ncontent-type: application/json\nx-slidax-token: right\n"
        "content-length: 50\n\nx",
        "POST /api/x HTTP/1.1\nhost: {host}\ncontent-type: application/json\nx-slidax-token: right\n"
        "transfer-encoding: chunked\n\n1\nx\n",
        "POST /api/x HTTP/1.1\nhost: {host}\ncontent-type: application/json\ncontent-length: 50\n\nx",
        "PUT /api/x HTTP/1.1\nhost: {host}\nx-slidax-token: right\ncontent-length: 5000000\n\nx",
    ],
)
@pytest.mark.parametrize("drip", [False, True])
def test_the_connection_of_an_unfinished_request_is_closed(port, text, drip):
    begun = time.monotonic()
    with opened(port, text) as link:
        if drip:
            _dripped(link)
        assert is_closed(link, 5.0)
    assert time.monotonic() - begun < 4.0


def _dripped(link):
    until = time.monotonic() + 3.0
    try:
        while time.monotonic() < until:
            link.sendall(b"x")
            time.sleep(0.05)
    except OSError:
        return
    raise AssertionError("the connection stays open")


def test_each_request_on_a_connection_has_its_own_time_limit(port):
    with opened(port, GOOD) as link:
        assert status(link) == 200
        time.sleep(1.2)
        link.sendall(b"GET /api/x HTTP/1.1\r\n")
        assert is_closed(link, 5.0)
    with opened(port, GOOD) as link:
        for _ in range(3):
            assert status(link) == 200
            time.sleep(0.6)
            link.sendall(GOOD.format(host=f"127.0.0.1:{port}").replace("\n", "\r\n").encode())
        assert status(link) == 200


def test_a_slow_answer_is_not_interrupted(port):
    with opened(port, GOOD.replace("/api/x", "/slow").replace("x-slidax-token: right\n", "")) as link:
        assert status(link) == 200


def test_a_client_that_does_not_read_does_not_block_others(port):
    links = [opened(port, "GET / HTTP/1.1\nhost: {host}\n\n") for _ in range(120)]
    with opened(port, GOOD) as page:
        assert status(page) == 200
    time.sleep(1.5)
    assert all(is_closed(link, 5.0) for link in links)
    for link in links:
        link.close()
