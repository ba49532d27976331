"""The server of `lightwell view`: who may ask, what is served and how, malformed and half-open requests, Ctrl-C."""

import base64
import gzip
import hashlib
import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

from lightwell.asset.page import viewer_html
from lightwell.serving import server as local_server
from lightwell.serving.folder import checked_folder, open_server, parse_range
from lightwell.serving.server import Answer

PAGE = "<style>p{}</style><script>let a = 1</script><p>page</p>" + "<p>text</p>" * 200
ASSET = bytes(range(256)) * 40


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "index.html").write_text(PAGE)
    (folder / "scene.glb").write_bytes(ASSET)
    (folder / "report.json").write_text("[" + "1," * 2000 + "1]")
    (folder / ".lightwell").mkdir()
    (folder / ".lightwell/plan.json").write_text("{}")
    (folder / "mlp").mkdir()
    (folder / "mlp/index.html").write_text("<p>field</p>")
    (tmp_path / "secret.txt").write_text("secret")
    return folder


@pytest.fixture
def server(folder):
    with open_server(checked_folder(str(folder))) as server:
        yield server


def _ask(server, path="/", method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in {"Host": f"127.0.0.1:{server.port}", **headers}.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read()


def _raw(server, data: bytes) -> bytes:
    """What comes back for raw bytes until the server closes, or for half a second."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as client:
        client.sendall(data)
        client.settimeout(0.5)
        found = b""
        try:
            while part := client.recv(65536):
                found += part
        except (TimeoutError, ConnectionResetError):
            pass
        return found


def test_it_serves_the_page_and_the_asset(server):
    status, headers, body = _ask(server)
    assert status == 200 and body.decode() == PAGE and headers["Content-Type"] == "text/html; charset=utf-8"
    status, headers, body = _ask(server, "/scene.glb")
    assert body == ASSET and headers["Content-Type"] == "model/gltf-binary" and headers["Accept-Ranges"] == "bytes"
    assert _ask(server, "/mlp/")[2] == b"<p>field</p>"
    assert _ask(server, "/mlp")[0] == 301 and _ask(server, "//mlp")[1]["Location"] == "/mlp/"


@pytest.mark.parametrize(
    "path",
    ["/.lightwell/plan.json", "/../secret.txt", "/%2e%2e/secret.txt", "/%2e%2e%2fsecret.txt", "/..%5csecret.txt", 
     "/none", "/%00", "/index.html%00.glb", "/%ff", "/" + "a" * 5000, "/mlp/none/", "/scene.glb/x", "/C:/x"],
)  # fmt: skip
def test_it_serves_nothing_else(server, path, capfd):
    assert _ask(server, path)[0] == 404
    assert capfd.readouterr() == ("", "")


def test_links_out_of_the_folder_are_not_followed(server, folder):
    (folder / "out.txt").symlink_to(folder.parent / "secret.txt")
    (folder / "up").symlink_to(folder.parent)
    (folder / "hidden.json").symlink_to(folder / ".lightwell/plan.json")
    (folder / "circle").symlink_to(folder / "circle")
    (folder / "inside.glb").symlink_to(folder / "scene.glb")
    for path in ("/out.txt", "/up/secret.txt", "/hidden.json", "/circle"):
        assert _ask(server, path)[0] == 404
    assert _ask(server, "/inside.glb")[0] == 200


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Host": "evil.example:{port}"}, {"Host": "127.0.0.1"}, {"Host": "127.0.0.1:1"},
     {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "http://127.0.0.1:1"}],
)  # fmt: skip
def test_other_sites_are_refused(server, headers):
    headers = {name: value.format(port=server.port) for name, value in headers.items()}
    assert _ask(server, **headers)[0] == 403
    assert _ask(server, Host=f"localhost:{server.port}", Origin=f"http://localhost:{server.port}")[0] == 200


def test_a_request_without_a_host_or_with_two_is_refused(server):
    assert b" 403 " in _raw(server, b"GET / HTTP/1.1\r\nConnection: close\r\n\r\n")
    hosts = f"Host: 127.0.0.1:{server.port}\r\nHost: evil.example\r\n".encode()
    assert b" 200 " not in _raw(server, b"GET / HTTP/1.1\r\n" + hosts + b"Connection: close\r\n\r\n")


def test_every_answer_carries_the_headers_of_a_careful_page(server):
    for path in ("/", "/scene.glb", "/none"):
        headers = _ask(server, path)[1]
        assert headers["X-Content-Type-Options"] == "nosniff" and headers["X-Frame-Options"] == "DENY"
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin" and "Server" not in headers
    scripts = re.search(r"script-src ([^;]*)", _ask(server)[1]["Content-Security-Policy"])[1]
    assert scripts.count("'sha256-") == 1 and "unsafe-inline" not in scripts


def test_a_script_that_a_page_unpacks_and_runs_is_allowed_by_the_hash_that_it_says():
    viewer = viewer_html()
    said = re.search(r'data-bytes="(\d+)" data-sha256="([^"]+)" id="lightwell-lens">([^<]+)<', viewer)
    script = gzip.decompress(base64.b64decode(said[3]))
    assert len(script) == int(said[1]) and base64.b64encode(hashlib.sha256(script).digest()).decode() == said[2]
    policy = dict(Answer.page(viewer.encode()).headers)["Content-Security-Policy"]
    assert policy.count("'sha256-") == 2 and f" 'sha256-{said[2]}'" in policy


@pytest.mark.parametrize(
    ("asked", "found"),
    [("bytes=0-9", (0, 9)), ("bytes=5-", (5, 99)), ("bytes=-7", (93, 99)), ("bytes=90-200", (90, 99)),
     ("bytes=-200", (0, 99)), ("bytes=0-", (0, 99)), ("", None), ("bytes=-", None), ("bytes=9-3", None),
     ("bytes=0-1,5-6", None), ("lines=1-2", None), ("bytes=a-b", None)],
)  # fmt: skip
def test_ranges(asked, found):
    assert parse_range(asked, 100) == found


def test_a_range_is_sent_or_lies_outside(server):
    status, headers, body = _ask(server, "/scene.glb", Range="bytes=300-309")
    assert (status, body, headers["Content-Range"]) == (206, ASSET[300:310], f"bytes 300-309/{len(ASSET)}")
    assert _ask(server, "/scene.glb", Range="bytes=-5")[2] == ASSET[-5:]
    for asked in (f"bytes={len(ASSET)}-", "bytes=-0"):
        status, headers, body = _ask(server, "/scene.glb", Range=asked)
        assert (status, headers["Content-Range"], body) == (416, f"bytes */{len(ASSET)}", b"")
    assert _ask(server, "/scene.glb", Range="bytes=0-4", If_Range='"old"')[0] == 200


def test_text_is_compressed_where_it_is_wanted(server, folder):
    _, headers, body = _ask(server, "/report.json", Accept_Encoding="gzip, br")
    assert headers["Content-Encoding"] == "gzip" and gzip.decompress(body) == (folder / "report.json").read_bytes()
    for accepted in ("gzip;q=0", "br", ""):
        assert _ask(server, "/report.json", Accept_Encoding=accepted)[1]["Content-Encoding"] is None
    assert _ask(server, "/scene.glb", Accept_Encoding="gzip")[1]["Content-Encoding"] is None


def test_head_has_the_headers_alone_and_other_methods_are_not_known(server):
    status, headers, body = _ask(server, "/scene.glb", method="HEAD")
    assert (status, headers["Content-Length"], body) == (200, str(len(ASSET)), b"")
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        status, headers, _ = _ask(server, "/", method=method)
        assert status == 405 and headers["Allow"] == "GET, HEAD"


@pytest.mark.parametrize(
    "data",
    [b"nonsense\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"\0\0\0\0\r\n\r\n",
     b"GET / HTTP/1.1\r\nA b: c\r\n\r\n",
     b"GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n", b"GET / HTTP/1.1\r\nX: " + b"y" * 20000 + b"\r\n\r\n",
     b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n"],
)  # fmt: skip
def test_malformed_requests_are_refused_in_silence(server, data, capfd):
    assert b" 200 " not in _raw(server, data)[:20]
    assert _ask(server)[0] == 200
    assert capfd.readouterr() == ("", "")


def test_clients_that_leave_are_not_mentioned(server, folder, capfd):
    (folder / "large.bin").write_bytes(bytes(1 << 24))
    request = f"GET /large.bin HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode()
    for _ in range(20):
        client = socket.create_connection(("127.0.0.1", server.port))
        # Closing with a reset, in the middle of the answer.
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        client.sendall(request)
        client.recv(100)
        client.close()
    assert _ask(server)[0] == 200
    assert capfd.readouterr() == ("", "")


def test_half_open_connections_neither_block_nor_hold_threads(server):
    threads = threading.active_count()
    clients = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(500)]
    try:
        for client in clients[::2]:
            client.sendall(b"GET / HTTP/1.1\r\nHost: ")
        begin = time.monotonic()
        assert _ask(server)[0] == 200
        # 0.1 s on an idle machine (benchmarks/servers.py); a machine that runs other tests may take longer.
        assert time.monotonic() - begin < 2
        assert threading.active_count() == threads
    finally:
        for client in clients:
            client.close()


def test_too_many_clients_are_told_so(server, monkeypatch):
    clients = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(local_server.MOST_CLIENTS)]
    try:
        _wait_until(lambda: b" 503 " in _raw(server, b""))
    finally:
        for client in clients:
            client.close()
    _wait_until(lambda: b" 503 " not in _raw(server, b"GET /"))
    assert _ask(server)[0] == 200


@pytest.mark.slow
def test_a_request_that_trickles_in_is_closed_after_its_time(server):
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        client.settimeout(1)
        begin = time.monotonic()
        while time.monotonic() - begin < local_server.SECONDS + 10:
            try:
                client.sendall(b"G")
                if client.recv(100) == b"":
                    break
            except TimeoutError:
                continue
            except OSError:
                break
        assert local_server.SECONDS - 1 < time.monotonic() - begin < local_server.SECONDS + 5


def _wait_until(holds) -> None:
    for _ in range(200):
        if holds():
            return
        time.sleep(0.05)
    pytest.fail("it did not come to hold within 10 s")


def test_what_is_closed_already_can_be_closed(folder):
    """As by a request that wakes the server's thread before `close` does."""
    with open_server(checked_folder(str(folder))) as server:
        server.close()


def test_a_port_in_use_is_one_line(server, folder):
    with pytest.raises(ValueError, match=r"^view: port \d+ cannot be opened \(.*\); choose another with --port$"):
        open_server(folder, server.port)
    with pytest.raises(ValueError, match="port 99999 cannot be opened"):
        open_server(folder, 99999)


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.3])
def test_an_interrupt_is_exit_code_130_and_quiet(folder, delay):
    command = [sys.executable, "-m", "lightwell", "view", str(folder), "--no-open"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline().startswith("http://127.0.0.1:")
    time.sleep(delay)
    os.kill(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (130, "", "")
