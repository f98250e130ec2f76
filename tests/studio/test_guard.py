import pytest

pytest.importorskip("starlette", reason="the extra `studio` is not installed")
pytest.importorskip("httpx2", reason="Starlette's test client needs httpx2")

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.testclient import TestClient

from slidax.studio import guard
from slidax.studio.guard import Guard

PORT, TOKEN = 8577, "right"


async def _echo(request):
    try:
        body = await request.body()
    except guard.TooLargeError:
        return Response(status_code=413)
    return JSONResponse({"length": len(body)})


@pytest.fixture
def client():
    routes = [Route("/", _echo, methods=["GET"]), Route("/api/x", _echo, methods=["GET", "POST", "PUT", "DELETE"])]
    app = Starlette(routes=routes, middleware=[Middleware(Guard, port=PORT, token=TOKEN)])
    with TestClient(app, base_url=f"http://127.0.0.1:{PORT}", client=("127.0.0.1", 1234)) as guarded:
        guarded.headers["x-slidax-token"] = TOKEN
        yield guarded


@pytest.mark.parametrize("host", [f"127.0.0.1:{PORT}", f"localhost:{PORT}", f"[::1]:{PORT}", f"LOCALHOST:{PORT}"])
def test_requests_to_loopback_at_the_servers_port_are_answered(client, host):
    assert client.get("/", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "host",
    [
        *("127.0.0.1", "127.0.0.1:80", f"127.0.0.1.evil.example:{PORT}", f"evil.example:{PORT}"),
        *(f"127.0.0.1:{PORT}@evil.example", f"localhost.:{PORT}", f"0.0.0.0:{PORT}", f"2130706433:{PORT}"),
        *(f"[::ffff:127.0.0.1]:{PORT}", f" 127.0.0.1:{PORT},evil.example", ""),
    ],
)
def test_a_request_with_another_host_name_is_refused(client, host):
    assert client.get("/", headers={"host": host}).status_code == 403
    assert client.post("/api/x", json={}, headers={"host": host}).status_code == 403


@pytest.mark.parametrize(
    "headers",
    [
        *({"origin": "http://evil.example"}, {"origin": "null"}, {"origin": f"https://127.0.0.1:{PORT}"}),
        *({"origin": "http://127.0.0.1:9999"}, {"origin": f"http://localhost:{PORT}"}),
        *({"sec-fetch-site": "cross-site"}, {"sec-fetch-site": "same-site"}, {"sec-fetch-site": "none"}),
        {"sec-fetch-site": "anything"},
    ],
)
def test_a_request_from_another_web_page_is_refused(client, headers):
    assert client.post("/api/x", json={}, headers=headers).status_code == 403


def test_requests_of_the_studios_own_page_are_answered(client):
    headers = {"origin": f"http://127.0.0.1:{PORT}", "sec-fetch-site": "same-origin"}
    assert client.post("/api/x", json={}, headers=headers).json() == {"length": 2}
    assert client.get("/", headers={"sec-fetch-site": "none"}).status_code == 200


@pytest.mark.parametrize("token", ["", "wrong", "right ", "righ", "rightright", "ümlaut".encode()])
def test_requests_without_the_right_token_are_refused(client, token):
    for method in ("GET", "POST", "PUT", "DELETE"):
        headers = {"x-slidax-token": token, "content-type": "application/json"}
        assert client.request(method, "/api/x", headers=headers).status_code == 401
    client.cookies.set("x-slidax-token", TOKEN)
    assert client.get("/api/x", headers={"x-slidax-token": ""}).status_code == 401


def test_a_request_from_another_machine_is_refused():
    app = Starlette(routes=[Route("/", _echo)], middleware=[Middleware(Guard, port=PORT, token=TOKEN)])
    for host in ("192.168.1.7", "10.0.0.1", "::ffff:192.168.1.7", "not an address"):
        with TestClient(app, base_url=f"http://127.0.0.1:{PORT}", client=(host, 1)) as far:
            assert far.get("/", headers={"x-forwarded-for": "127.0.0.1"}).status_code == 403


def test_posts_without_json_content_type_are_refused(client):
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""):
        assert client.post("/api/x", content=b"{}", headers={"content-type": kind}).status_code == 415


def test_too_large_a_body_is_refused_with_or_without_a_declared_length(client, monkeypatch):
    monkeypatch.setattr(guard, "LARGEST", 1000)
    monkeypatch.setattr(guard, "LARGEST_FILE", 2000)
    headers = {"content-type": "application/json"}
    assert client.post("/api/x", content=b"x" * 1001, headers=headers).status_code == 413
    assert client.post("/api/x", content=iter([b"x" * 600] * 2), headers=headers).status_code == 413
    assert client.post("/api/x", content=iter([b"x" * 600]), headers=headers).json() == {"length": 600}
    assert client.put("/api/x", content=b"x" * 1500).json() == {"length": 1500}
    assert client.put("/api/x", content=b"x" * 2001).status_code == 413


def test_every_answer_has_a_content_security_policy(client):
    for answer in (client.get("/"), client.get("/", headers={"host": "evil"}), client.get("/nothing")):
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert "access-control-allow-origin" not in answer.headers


def test_web_socket_connections_are_refused(client):
    from starlette.websockets import WebSocketDisconnect

    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/api/x"):
        pass
