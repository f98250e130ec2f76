import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the extra `studio` is not installed")
pytest.importorskip("httpx2", reason="Starlette's test client needs httpx2")

from starlette.testclient import TestClient

from slidax.studio.bench import OWN_FAULT
from slidax.studio.jobs import COMMANDS
from slidax.studio.requests import QUESTIONS, JobRequest, RequestError, ScenarioRequest, read_request

JSON = {"content-type": "application/json"}

ODD = [
    *(None, True, False, 0, -1, 1.5, 10**15, -1e300, 10**308, "", "x", " ", "\0", "..", "/etc/passwd", "é" * 300),
    *("example-4.1", "1e400", "nan", "\n", "{{", "a" * 5000, "💥", "\u202e", "\ufeff", "-1", "[", "x: ["),
    *([], [1], [[]], [None], {}, {"x": 1}, {"": ""}, {"x": {"y": []}}, [0.0] * 500, [{}] * 20),
]
"""Values of every kind, for any field."""

RAW = [
    *(b"", b"\xff\xfe", b"nul", b"[]", b'"x"', b"1", b"null", b"{", b'{"a"}', b'{"name": NaN}', b'{"x": Infinity}'),
    b'{"name": ' + b"9" * 400 + b"}",
    b'{"name": ' + b"9" * 5000 + b"}",
    b'{"changes": {"simulation.t1": 1' + b"0" * 400 + b"}}",
    b'{"changes": {"simulation.t1": 1e999}}',
    b'{"changes": {"x": ' + b"[" * 60 + b"]" * 60 + b"}}",
    b'{"changes": {"x": ' + b'{"a":' * 60 + b"1" + b"}" * 60 + b"}}",
    b"[" * 500_000,
    b'{"a":' * 300_000,
    b'{"name": "\\ud800"}',
    b'{"changes": {"title": "\\udfff"}}',
    b'{"changes": {"\\ud800": 1}}',
    b'{"options": {"set": {"title": ["\\ud800"]}}, "kind": "run"}',
    '{"x": "x"}'.encode("utf-16"),
]
"""Bodies that are no requests."""

VALID = {
    "check": {"name": "example-4.1", "path": "x.yaml", "text": "title: x", "changes": {"simulation.t1": 1.0}},
    "run": {"name": "example-4.1", "path": "x.yaml", "text": "title: x", "changes": {"simulation.t1": 0.01}},
    "manifest": {"name": "example-4.1", "path": "x.yaml", "text": "title: x", "changes": {"simulation.t1": 1.0}},
    "compiled": {"name": "nothing", "path": "x.yaml", "text": "title: x", "changes": {"simulation.t1": 1.0}},
    "new": {"robot": "panda", "rate": 500.0, "tip": "x"},
    "catalogue": {},
    "part": {"name": "cftsmppc"},
    "jobs": {"kind": "nothing", "options": {"scenario": "example-4.1"}},
}


def paths_of(data, before=""):
    for key, value in data.items() if isinstance(data, dict) else ():
        yield f"{before}{key}"
        yield from paths_of(value, f"{before}{key}.")


class Asker:
    def __init__(self, client):
        self.client = client
        self.restarts = self.restarted()
        self.posts = 0

    def restarted(self):
        return int(self.client.get("/api/about").json()["restarts"])

    def post(self, do, body):
        content = body if isinstance(body, bytes) else json.dumps(body).encode()
        answer = self.client.post(f"/api/{do}", content=content, headers=JSON)
        self.posts += 1
        place = (do, content[:300], answer.status_code)
        assert answer.status_code < 500, place
        if answer.status_code >= 300:
            message = answer.json()["error"]["message"]
            assert message and OWN_FAULT not in message and "its process ended" not in message, (place, message)
            assert answer.status_code in (400, 403, 404, 409, 413, 422, 429), place
        elif do == "jobs":
            self.client.delete(f"/api/jobs/{answer.json()['id']}")
        return int(answer.status_code)

    def check(self):
        assert self.restarted() == self.restarts


@pytest.fixture
def asker(client):
    checker = Asker(client)
    yield checker
    checker.check()


@pytest.mark.parametrize("content", RAW)
def test_an_invalid_request_body_is_refused_in_one_line(content):
    for kind in (ScenarioRequest, JobRequest):
        with pytest.raises(RequestError) as refused:
            read_request(content, kind)
        assert 5 < len(str(refused.value)) < 300 and "\n" not in str(refused.value)


@pytest.mark.parametrize("do", [*QUESTIONS, "jobs"])
def test_every_request_field_is_checked_for_its_type(do):
    kind = QUESTIONS.get(do, JobRequest)
    types = {"string": str, "number": (int, float), "object": dict, "null": type(None)}
    for field, schema in kind.model_json_schema().get("properties", {}).items():
        expected = tuple(types[item["type"]] for item in schema.get("anyOf", [schema]))
        for value in ODD:
            good = isinstance(value, expected) and not isinstance(value, bool)
            refusal = ""
            try:
                read_request(json.dumps(VALID[do] | {field: value}).encode(), kind)
            except RequestError as error:
                refusal = str(error)
            if refusal:
                # A range or a length may be wrong, too.
                assert refusal.startswith(field), (field, value, refusal)
                assert not good or isinstance(value, float | int | str), (field, value, refusal)
            else:
                assert good, (field, value)
    with pytest.raises(RequestError, match=r"nothing: unknown field"):
        read_request(json.dumps(VALID[do] | {"nothing": 1}).encode(), kind)
    for field, about in kind.model_fields.items():
        if about.is_required():
            with pytest.raises(RequestError, match=f"{field}: this field is required"):
                read_request(json.dumps({k: v for k, v in VALID[do].items() if k != field}).encode(), kind)


def test_requests_with_wrong_types_or_incomplete_surrogates_are_refused(asker):
    bad = (
        ("check", b'{"name": "example-4.1", "changes": {"title": "\\ud800"}}'),
        ("check", {"name": "example-4.1", "changes": [1]}),
        ("new", {"robot": "panda", "rate": "x"}),
        ("new", {"robot": ["panda"]}),
        ("part", {"name": {"x": 1}}),
        ("jobs", {"kind": "run", "options": [1]}),
    )
    for do, body in bad:
        assert asker.post(do, body) == 400


def fuzz(asker, rounds, seed, ways=(*QUESTIONS, "jobs")):
    random = np.random.default_rng(seed)
    scenario = read_yaml_of(asker)
    fields = list(paths_of(scenario))
    for number in range(rounds):
        do = ways[number % len(ways)]
        body = dict(VALID[do])
        if do == "jobs":
            kind = str(random.choice(list(COMMANDS)))
            readers = list(COMMANDS[kind][1])
            body = {"kind": kind, "options": {str(random.choice(readers)): pick(random) for _ in range(3)}}
        elif "changes" in body and random.random() < 0.8:
            path = str(random.choice(fields))
            body = {"name": "example-4.1", "changes": {path: pick(random)}}
            if do == "run":
                body["changes"].setdefault("simulation.t1", 0.01)
        elif body:
            body[str(random.choice(list(body)))] = pick(random)
            for key in random.choice(list(body), size=random.integers(0, len(body)), replace=False):
                body.pop(str(key), None)
        asker.post(do, body)


def pick(random):
    return ODD[random.integers(len(ODD))]


def read_yaml_of(asker):
    from slidax.scenarios.yaml_text import read_yaml

    return read_yaml(asker.client.post("/api/check", json={"name": "example-4.1"}).json()["text"])


def test_random_requests_do_not_crash_the_worker(asker):
    fuzz(asker, 20, 38, ("check", "part", "jobs", "catalogue"))


@pytest.mark.full
@pytest.mark.parametrize("seed", range(4))
def test_thousands_of_random_requests_to_every_address_do_not_crash_the_worker(asker, seed):
    for content in RAW:
        for do in (*QUESTIONS, "jobs"):
            asker.post(do, content)
    fuzz(asker, 1000, seed)


def test_a_file_name_that_is_not_unicode_does_not_break_the_listing(client, shared_root):
    path = Path(str(shared_root) + "/\udcff-odd.yaml")
    path.write_text("title: x\n")
    try:
        answer = client.get("/api/files")
    finally:
        path.unlink()
    assert answer.status_code == 200 and answer.json()["files"]


@pytest.mark.parametrize(
    "address",
    [
        *("/results/%C3%A9/x", "/results/x/%00", "/api/jobs/%FF", "/api/file?path=%ED%A0%80"),
        *("/api/file?path=a&path=b", "/%FF"),
    ],
)
def test_invalid_request_addresses_are_refused(client, address):
    client.post("/api/jobs", content=b'{"kind": "certify", "options": {"scenario": "nothing"}}', headers=JSON)
    assert client.get(address).status_code in (403, 404, 422)


def test_the_page_without_the_token_contains_no_user_data(tmp_path):
    from slidax.studio.app import DEFAULT, Studio
    from slidax.studio.files import Folder

    (tmp_path / "mine.yaml").write_text("title: a secret arm\n")
    studio = Studio(Folder(tmp_path), module="slidax.cli", opened="mine.yaml")
    questions = []

    async def ask(question, **_):
        questions.append(question)
        return {"manifest": {"title": "built in"}}, b""

    async def nothing():
        pass

    studio.bench.ask, studio.bench.warm = ask, nothing
    with TestClient(studio.app(port=80, token="right"), base_url="http://127.0.0.1", client=("127.0.0.1", 1)) as client:
        pages = [client.get("/", headers={"host": "127.0.0.1:80"}) for _ in range(3)]
        for page in pages:
            assert page.status_code == 200 and "built in" in page.text
            assert "secret" not in page.text and "mine.yaml" not in page.text and str(tmp_path) not in page.text
    # Without the token, only the first request gives the workbench work.
    assert questions == [{"name": DEFAULT, "do": "manifest"}]
