"""Pages in a headless Chromium under the content security policy of the server."""

import subprocess
from pathlib import Path

import pytest

from lightwell.serving.folder import open_server

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "lightwell"
POLICY_BROKEN = "Content Security Policy"
# The browser's virtual time runs on while a worker starts: on a busy machine it ends too soon now and then.
TRIES = 4
# What the pages use: their own scripts, a worker and a picture from memory, WebAssembly, a file of the folder.
PAGE = """<!doctype html><body><script type="module">
const said = [];
const blob = text => URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
said.push(await new Promise(done => {
  new Worker(blob("postMessage('worker')")).onmessage = message => done(message.data);
}));
said.push(await (await fetch("note.json")).json());
await WebAssembly.compile(new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0]));
const picture = new Image();
picture.src = "data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='3' height='3'/>";
await picture.decode();
document.body.style.color = "red";
document.body.append(said.join(" ") + " wasm picture", document.createElement("hr"));
</script></body>"""
# What a hostile name in a scene might become.
INJECTED = """<!doctype html><body><script>
const box = document.createElement("div");
box.innerHTML = "<img src=x onerror='document.body.append(1 + 1 + \\"injected\\")'>";
document.body.append(box, "own script");
const late = document.createElement("script");
late.textContent = "document.body.append(2 + 2 + 'injected')";
document.body.append(late);
</script></body>"""


@pytest.fixture
def show(tmp_path):
    """A function that loads a page and returns its text and what the browser logged."""
    found = subprocess.run(["sh", ROOT / "tools/find-chromium.sh"], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    chromium = found.stdout.strip()

    def show(page: str, ends: str = "") -> tuple[str, str]:
        (tmp_path / "index.html").write_text(page)
        (tmp_path / "note.json").write_text('"note"')
        with open_server(tmp_path) as server:
            flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--timeout=20000"]
            command = [chromium, *flags, "--virtual-time-budget=4000", "--dump-dom", server.url]
            for _ in range(TRIES):
                done = subprocess.run(command, capture_output=True, text=True, timeout=120)
                if ends in done.stdout:
                    break
        return done.stdout, done.stderr

    return show


def test_what_the_pages_use_is_allowed(show):
    text, log = show(PAGE, ends="<hr>")
    assert "worker note wasm picture" in text and POLICY_BROKEN not in log


def test_scripts_that_are_not_written_into_the_page_do_not_run(show):
    text, log = show(INJECTED)
    assert "own script" in text and "2injected" not in text and "4injected" not in text
    assert log.count(POLICY_BROKEN) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("page", ["viewer/index.html", "viewer/probes.html", "cache/live.html"])
def test_the_pages_that_ship_load_under_the_policy(show, page):
    _, log = show((PACKAGE / page).read_text())
    assert POLICY_BROKEN not in log
