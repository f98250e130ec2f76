"""One studio for all tests of a pytest worker, because its workbench takes seconds to start."""

import pytest

from .tricks import planted


@pytest.fixture
def root(tmp_path):
    return planted(tmp_path)


@pytest.fixture(scope="session")
def shared_root(tmp_path_factory):
    return planted(tmp_path_factory.mktemp("studio"))


@pytest.fixture(scope="session")
def client(shared_root):
    from starlette.testclient import TestClient

    from slidax.studio.app import Studio
    from slidax.studio.files import Folder

    port = 8577
    app = Studio(Folder(shared_root), module="slidax.cli", opened="").app(port=port, token="right")
    with TestClient(app, base_url=f"http://127.0.0.1:{port}", client=("127.0.0.1", 1)) as connected:
        connected.headers["x-slidax-token"] = "right"
        yield connected
