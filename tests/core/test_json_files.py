"""Damaged JSON of a work folder is a note, not the end."""

import pytest

from lightwell.core.json_files import read_json


def test_what_is_sound_is_read_and_what_is_absent_is_none(tmp_path, caplog):
    (tmp_path / "plan.json").write_text('{"steps": 3}')
    assert read_json(tmp_path / "plan.json", dict) == {"steps": 3}
    assert read_json(tmp_path / "none.json", dict) is None and not caplog.messages


@pytest.mark.parametrize("content", [b"", b'{"steps": 3', b"[1]", b"\xff\xfe", b"[" * 100_000])
def test_what_is_damaged_is_none_with_a_note(tmp_path, caplog, content):
    path = tmp_path / "plan.json"
    path.write_bytes(content)
    assert read_json(path, dict) is None
    assert (
        len(caplog.messages) == 1 and "is damaged and is made again" in caplog.text and "\n" not in caplog.messages[0]
    )
