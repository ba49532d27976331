"""Batches: what is done is kept, what was interrupted goes on, what fails is told."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from lightwell.baking.batch import DONE, FAILED, STARTED, BatchScene, BatchSettings, batch
from lightwell.cli import main
from lightwell.core.progress import Progress

ROOT = Path(__file__).parents[2]


class Runs:
    """Stands for the bakes: writes a report, or fails, or is interrupted."""

    def __init__(self, codes=None):
        self.lines, self.codes = [], codes or {}

    def __call__(self, words):
        self.lines.append(words)
        out = Path(next(word for word in words if word.startswith("--out=")).partition("=")[2])
        log = Path(next(word for word in words if word.startswith("--log=")).partition("=")[2])
        code = self.codes.get(out.name, 0)
        if code:
            log.write_text("2026-01-01 00:00:00,000 ERROR   ValueError: the scene is empty\n")
            return code
        out.mkdir(exist_ok=True)
        (out / "report.json").write_text(json.dumps({"relative_error": 0.05, "verdict": "good", "bytes": 10}))
        return 0


def settings(folder, names="abc", words=()):
    for name in names:
        path = folder / f"{name}.glb"
        if not path.exists():
            path.write_bytes(name.encode())
    scenes = [BatchScene(n, str(folder / f"{n}.glb"), folder / "out" / n, words) for n in names]
    return BatchSettings(folder / "out", tuple(scenes))


def run(asked, runs):
    return batch(asked, runs, Progress(quiet=True))


def test_a_failed_scene_does_not_end_the_batch_and_is_baked_again(tmp_path):
    runs = Runs({"b": 2})
    rows = run(settings(tmp_path), runs)["scenes"]
    assert [row["state"] for row in rows] == [DONE, FAILED, DONE]
    assert rows[1]["reason"] == "the scene is empty" and rows[0]["relative_error"] == 0.05
    page = (tmp_path / "out/batch.html").read_text()
    assert "the scene is empty" in page and 'href="a/report.html"' in page
    again = Runs()
    assert [row["state"] for row in run(settings(tmp_path), again)["scenes"]] == [DONE] * 3
    assert [words[1][-5:] for words in again.lines] == ["b.glb"] and "--resume" not in again.lines[0]


def test_an_interrupted_batch_goes_on_where_it_was(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(settings(tmp_path), Runs({"b": 130}))
    found = json.loads((tmp_path / "out/batch.json").read_text())["scenes"]
    assert [row["state"] for row in found] == [DONE, STARTED, "waiting"]
    runs = Runs()
    run(settings(tmp_path), runs)
    assert [words[1][-5:] for words in runs.lines] == ["b.glb", "c.glb"]
    assert "--resume" in runs.lines[0] and "--resume" not in runs.lines[1]


def test_changed_scenes_options_and_lost_reports_are_baked_anew(tmp_path):
    run(settings(tmp_path), Runs())
    (tmp_path / "b.glb").write_bytes(b"moved")
    (tmp_path / "out/c/report.json").unlink()
    runs = Runs()
    run(settings(tmp_path), runs)
    assert [words[1][-5:] for words in runs.lines] == ["b.glb", "c.glb"]
    runs = Runs()
    run(settings(tmp_path, words=("--seed=4",)), runs)
    assert len(runs.lines) == 3 and runs.lines[0][-1] == "--seed=4"


def test_an_interrupt_keeps_what_is_finished_or_begun_behind_it(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(settings(tmp_path, "abcd"), Runs({"d": 130}))
    (tmp_path / "a.glb").write_bytes(b"moved")
    with pytest.raises(KeyboardInterrupt):
        run(settings(tmp_path, "abcd"), Runs({"a": 130}))
    found = json.loads((tmp_path / "out/batch.json").read_text())["scenes"]
    assert [row["state"] for row in found] == [STARTED, DONE, DONE, STARTED]
    runs = Runs()
    run(settings(tmp_path, "abcd"), runs)
    assert [words[1][-5:] for words in runs.lines] == ["a.glb", "d.glb"]
    assert all("--resume" in words for words in runs.lines)


@pytest.mark.parametrize("out", ["out", "."])
def test_what_the_batch_writes_beside_its_scenes_is_none_of_them(tmp_path, out):
    scenes = []
    for name in "ab":
        (tmp_path / f"{name}.gltf").write_text("{}")
        scenes.append(BatchScene(name, str(tmp_path / f"{name}.gltf"), tmp_path / out / name))
    log = tmp_path / "batch.log"
    asked = BatchSettings(tmp_path / out, tuple(scenes), aside=(log,))
    with pytest.raises(KeyboardInterrupt):
        run(asked, Runs({"b": 130}))
    log.write_text("ended")
    runs = Runs()
    run(asked, runs)
    assert [words[1][-6:] for words in runs.lines] == ["b.gltf"] and "--resume" in runs.lines[0]
    (tmp_path / "a.bin").write_bytes(b"1")
    runs = Runs()
    run(asked, runs)
    assert len(runs.lines) == 2


def test_options_of_file_and_line_and_mistakes_before_the_first_bake(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runs = Runs()
    monkeypatch.setattr("lightwell.cli.child.run_child", runs)
    Path("flats.toml").write_text(
        '[bake]\nseed = 3\n[scenes.a]\nscene = "cornell"\nfield = "lightmap"\nsize = 256\n'
        '[scenes.b]\nscene = "two-rooms"\n'
    )
    assert main(["batch", "flats.toml", "-o", "out", "--quality", "draft", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scenes"][1]["state"] == DONE
    assert runs.lines[0][5:] == ["--seed=3", "--field=lightmap", "--size=256", "--quality=draft"]
    assert runs.lines[1][5:] == ["--seed=3", "--quality=draft"]
    Path("flats.toml").write_text('[scenes.a]\nscene = "cornell"\n[scenes.b]\nscene = "cornell"\npreset = "larg"\n')
    assert main(["batch", "flats.toml", "-o", "other"]) == 2 and not Path("other").exists()
    assert "did you mean 'large'" in capsys.readouterr().err
    assert main(["batch", "nowhere"]) == 2 and main(["batch", "."]) == 2


def test_options_of_the_batch_come_after_those_of_a_scene_and_are_read_from_its_file(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runs = Runs()
    monkeypatch.setattr("lightwell.cli.child.run_child", runs)
    Path("lightwell.toml").write_text("[batch]\nviews = 9\n")
    Path("flats.toml").write_text(
        '[bake]\nseed = 1\npaths = 8\n[batch]\nout = "out"\nseed = 2\nquality = "draft"\njson = true\n'
        '[scenes.a]\nscene = "cornell"\nseed = 3\n[scenes.b]\nscene = "cornell"\n'
    )
    assert main(["batch", "flats.toml"]) == 0
    assert [row["folder"] for row in json.loads(capsys.readouterr().out)["scenes"]] == ["a", "b"]
    assert [sorted(words[5:]) for words in runs.lines] == [
        ["--paths=8", "--quality=draft", f"--seed={seed}"] for seed in (3, 2)
    ]
    assert Path("out/batch.json").is_file()
    assert main(["batch", "flats.toml", "--seed", "4", "-o", "other"]) == 0
    assert [words[-1] for words in runs.lines[2:]] == ["--seed=4"] * 2
    capsys.readouterr()
    assert main(["batch", "flats.toml", "--config", "lightwell.toml"]) == 2
    assert "'flats.toml' is the settings file of this batch; leave --config out" in capsys.readouterr().err


def test_files_of_others_in_the_folder_of_a_scene_are_overwritten_by_force(tmp_path):
    forced, runs = settings(tmp_path, "a"), Runs()
    run(replace(forced, force=True), runs)
    assert runs.lines[0][-1] == "--force"


def test_tables_of_one_file_are_scenes_of_their_own_and_none_overwrites_another(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runs = Runs()
    monkeypatch.setattr("lightwell.cli.child.run_child", runs)
    tables = '[scenes.out]\nscene = "cornell"\nseed = 1\n[scenes.b]\nscene = "cornell"\nseed = 2\n'
    Path("flats.toml").write_text(tables)
    assert main(["batch", "flats.toml", "-o", "baked"]) == 0
    assert [(words[2], words[5:]) for words in runs.lines] == [
        (f"--out={Path('baked') / name}", [f"--seed={k}"]) for name, k in (("out", 1), ("b", 2))
    ]
    Path("flats.toml").write_text('[bake]\nout = "here"\n' + tables)
    assert main(["batch", "flats.toml", "-o", "other"]) == 2 and len(runs.lines) == 2
    assert "scenes 'out' and 'b' have one folder, 'here'" in capsys.readouterr().err


def test_a_batch_opens_no_page_and_waits_for_no_save(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runs = Runs()
    monkeypatch.setattr("lightwell.cli.child.run_child", runs)
    Path("flats.toml").write_text(
        '[bake]\npreview = true\nwatch = true\nport = 8000\nno-open = true\nseed = 3\n[scenes.a]\nscene = "cornell"\n'
    )
    assert main(["batch", "flats.toml", "-o", "out"]) == 0
    assert runs.lines[0][5:] == ["--seed=3"]


@pytest.mark.slow
def test_a_killed_batch_leaves_no_process_and_goes_on(tmp_path):
    (tmp_path / "flats.toml").write_text(
        "[bake]\nsteps = 5\nshards = 1\nviews = 1\nstatic = false\n"
        '[scenes.a]\nscene = "cornell"\n[scenes.b]\nscene = "cornell"\nseed = 1\n'
    )
    argv = [sys.executable, "-m", "lightwell.cli", "batch", "flats.toml", "-o", "out"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(argv, cwd=tmp_path, env=environment)
    while not (tmp_path / "out/a/.lightwell").exists():
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert subprocess.run(argv, cwd=tmp_path, env=environment).returncode == 0
    rows = json.loads((tmp_path / "out/batch.json").read_text())["scenes"]
    assert [row["state"] for row in rows] == [DONE, DONE]
