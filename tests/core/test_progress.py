"""Progress bars in a notebook: HTML that is updated in place, without widgets."""

import sys
from types import ModuleType

import pytest
from rich.console import Console

from lightwell.core.progress import Progress


@pytest.fixture
def cell(monkeypatch):
    """What a notebook would show: an IPython that collects."""
    shown = []

    class Handle:
        def update(self, page):
            shown.append(page)

    def display(page, display_id):
        shown.append(page)
        return Handle()

    module = ModuleType("IPython.display")
    module.HTML, module.display = str, display
    monkeypatch.setitem(sys.modules, "IPython", ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    return shown


def test_a_bar_in_a_notebook_is_updated_in_place(cell):
    with Progress(console=Console(force_jupyter=True)).stage("trace <b>", 4, "rays") as bar:
        bar.advance(1)
        bar.move_to(4, "done")
    assert all("trace &lt;b&gt;" in page and "<progress" in page for page in cell)
    assert 'value="0.0"' in cell[0] and "rays" in cell[0]
    assert 'value="4"' in cell[-1] and "done" in cell[-1]


def test_quiet_shows_nothing(cell):
    with Progress(quiet=True, console=Console(force_jupyter=True)).stage("trace", 4) as bar:
        bar.advance(4)
    assert cell == []


def test_a_log_says_how_much_of_what_a_stage_does(caplog):
    with caplog.at_level("INFO"):
        for note in ("shards", "", "held-out views"):
            with Progress(quiet=True).stage("trace", 7, note):
                pass
    assert caplog.messages == ["trace: 7 shards", "trace: 7 parts", "trace: 7 held-out views"]
