"""``lightwell store``: says what is kept, and removes it."""

import json

import numpy as np

from lightwell.cli import main
from lightwell.core.keys import key
from lightwell.core.store import Store


def test_info_and_clear(tmp_path, capsys):
    store = Store(tmp_path)
    for k in range(3):
        store.get(key("lens.library", 1, k=k), lambda: {"x": np.zeros(100)})
    assert main(["store", "info", "--store", str(tmp_path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["functions"]["lens.library"]["entries"] == 3 and facts["bytes"] > 2400
    assert facts["limit_bytes"] == 20_000_000_000
    assert main(["store", "info", "--store", str(tmp_path)]) == 0
    assert "lens.library" in capsys.readouterr().out
    assert main(["store", "clear", "--store", str(tmp_path)]) == 0
    assert " removed" in capsys.readouterr().out and not store.entries()


def test_an_empty_store_and_a_bad_limit(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("LIGHTWELL_STORE", str(tmp_path / "none"))
    assert main(["store", "info"]) == 0 and ": 0 B of 20 GB" in capsys.readouterr().out
    monkeypatch.setenv("LIGHTWELL_STORE_LIMIT", "20GB")
    assert main(["store", "info"]) == 2
    assert "LIGHTWELL_STORE_LIMIT is '20GB'; set it to a number of bytes" in capsys.readouterr().err
