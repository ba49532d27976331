"""What a light map keeps while it is baked."""

import numpy as np

from lightwell.fields.lightmap.resume import kept


def test_a_damaged_file_is_made_again_with_a_note(tmp_path, caplog):
    path, made = tmp_path / "light.npz", []
    make = lambda: made.append(1) or {"x": np.arange(4.0)}  # noqa: E731
    assert kept(path, make)["x"].sum() == kept(path, make)["x"].sum() == 6 and len(made) == 1
    path.write_bytes(path.read_bytes()[:100])
    assert kept(path, make)["x"].sum() == 6 and len(made) == 2
    assert "damaged, and made again" in caplog.text and len(caplog.messages) == 1
