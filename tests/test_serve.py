"""The server of `lightwell view`: loopback only, the page and nothing hidden."""

import threading
import urllib.error
import urllib.request

import pytest

from lightwell.serve import checked_folder, open_server


@pytest.fixture
def address(tmp_path):
    (tmp_path / "index.html").write_text("<p>page</p>")
    (tmp_path / "scene.glb").write_bytes(b"glTF")
    (tmp_path / ".lightwell").mkdir()
    (tmp_path / ".lightwell/plan.json").write_text("{}")
    server = open_server(checked_folder(str(tmp_path)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_address
    server.shutdown()
    server.server_close()


def _get(address, path: str):
    return urllib.request.urlopen(f"http://{address[0]}:{address[1]}{path}", timeout=10)


def test_it_listens_on_loopback_only(address):
    assert address[0] == "127.0.0.1"


def test_it_serves_the_page_and_the_asset(address):
    assert b"page" in _get(address, "/").read()
    answer = _get(address, "/scene.glb")
    assert answer.read() == b"glTF" and answer.headers["Content-Type"] == "model/gltf-binary"


@pytest.mark.parametrize("path", ["/.lightwell/plan.json", "/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/none"])
def test_it_serves_nothing_else(address, path):
    with pytest.raises(urllib.error.HTTPError) as caught:
        _get(address, path)
    assert caught.value.code == 404


def test_a_port_in_use_is_one_line(address, tmp_path):
    with pytest.raises(ValueError, match="cannot be opened"):
        open_server(tmp_path, address[1])
