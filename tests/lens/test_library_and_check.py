"""Libraries as files, hostile files, and the verification tool with planted faults."""

import json

import numpy as np
import pytest
from PIL import Image

from lightwell.cli import main
from lightwell.core.store import Store, default_folder
from lightwell.lens import families
from lightwell.lens.bake import bake_nodes
from lightwell.lens.check import check
from lightwell.lens.errors import LensError
from lightwell.lens.library import MAGIC, Library, load, loads, two_arrays
from lightwell.lens.library_cache import LibraryCache
from lightwell.lens.plot import PANEL, panels
from lightwell.lens.recipes import Recipe, lossless
from lightwell.lens.spreadlet import CHARGE, Spreadlet
from lightwell.limits import Limits


@pytest.fixture(scope="module")
def library():
    family = families.depth(12.0, noise=0.05)
    made = Library(family, Recipe())
    made.nodes = bake_nodes(family, range(family.size), Recipe())
    return made


def test_save_load_save_gives_the_same_bytes(library, tmp_path):
    library.save(tmp_path / "a.lwsp")
    again = load(tmp_path / "a.lwsp")
    assert again.tobytes() == library.tobytes() and again.key() == library.key()
    assert not list(tmp_path.glob("*.part"))


def test_baking_again_gives_the_same_bytes(library):
    again, some = Library(library.family, Recipe()), range(0, library.family.size, 4)
    again.nodes = library.nodes | bake_nodes(library.family, some, Recipe())
    assert again.tobytes() == library.tobytes()


def test_large_offsets_take_sixteen_bits():
    family = families.depth(140.0, noise=0.5)
    wide = lossless(family.kernel(family.size - 1))
    made = Library(family, Recipe(), {(family.size - 1, 0): wide})
    again = loads(made.tobytes())
    assert int(wide.x.max()) > 127 and again.tobytes() == made.tobytes()


def _edited(library, change):
    data = library.tobytes()
    length = int(np.frombuffer(data, "<u4", 1, 8)[0])
    header = json.loads(data[12 : 12 + length])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    return MAGIC + np.array([1, len(text)], "<u4").tobytes() + text + data[12 + length :]


@pytest.mark.parametrize(
    "change",
    [
        lambda h: h.update(points=10**9),
        lambda h: h.update(points=-1),
        lambda h: h.update(offset_bits=7),
        lambda h: h.update(family="other"),
        lambda h: h.update(aperture="star"),
        lambda h: h.update(sha256="0" * 64),
        lambda h: h["axes"][0]["values"].reverse(),
        lambda h: h["axes"][0].update(values=["x"]),
        lambda h: h["records"]["node"].__setitem__(0, 10**6),
        lambda h: h["records"]["node"].__setitem__(0, 0.5),
        lambda h: h["records"]["first"].__setitem__(3, 10**8),
        lambda h: h["records"]["count"].__setitem__(3, -2),
        lambda h: h["records"]["count"].__setitem__(-1, h["records"]["count"][-1] - 1),
        lambda h: h["records"]["scale"].__setitem__(0, float("inf")),
        lambda h: h["records"]["kind"].__setitem__(0, "code"),
        lambda h: h["records"]["tier"].pop(),
        lambda h: h.pop("records"),
        lambda h: h.update(recipe={"unknown": 1}),
    ],
)
def test_hostile_files_are_refused_in_one_line(library, change):
    with pytest.raises(LensError) as error:
        loads(_edited(library, change), "bad.lwsp")
    assert "bad.lwsp" in str(error.value) and "\n" not in str(error.value)


def test_limits_bound_the_file_and_its_records(library, tmp_path):
    path = tmp_path / "disc.lwsp"
    library.save(path)
    assert load(path).nodes.keys() == library.nodes.keys()
    for limit in ("nodes", "decoded_bytes"):
        with pytest.raises(LensError, match=rf"disc.lwsp: .*more than the limit of 2\b.*--limit {limit}="):
            load(path, limits=Limits(**{limit: 2}))


def test_truncated_files_are_refused(library):
    data = library.tobytes()
    for end in (0, 3, 11, 40, len(data) // 2, len(data) - 1):
        with pytest.raises(LensError):
            loads(data[:end])
    with pytest.raises(LensError):
        loads(b"XXXX" + data[4:])
    with pytest.raises(LensError, match="version"):
        loads(data[:4] + b"\x09\0\0\0" + data[8:])


def test_two_arrays_hold_the_same_charges(library):
    points, ends = two_arrays(library)
    assert ends[-1] == len(points) and len(ends) == library.family.size + 1
    assert (np.diff(ends) >= 0).all() and np.isfinite(points).all()
    last = points[ends[-2] :]
    assert len(last) == len(library.nodes[library.family.size - 1, 0]) and abs(last[:, 2].sum()) < 1e-6


def test_a_sound_library_passes(library):
    assert not [f for f in check(library) if f.broken]


def planted(library: Library, fault: str) -> Library:
    """Copy a library with a fault in every sparse spreadlet."""
    changed = {}
    for key, s in library.nodes.items():
        if s.kind == CHARGE:
            x, y, q = s.x.copy(), s.y.copy(), s.q.copy()
            if fault == "dropped point":
                x, y, q = x[1:], y[1:], q[1:]
            elif fault == "wrong sign":
                q = -q
            elif fault == "transposed":
                x, y = y, x
            elif fault == "shifted":
                x = x + np.int16(1)
            elif fault == "broken sum":
                q[0] += 1
            s = Spreadlet(s.kind, x, y, q, s.scale, s.recipe, s.score)
        changed[key] = s
    return Library(library.family, library.recipe, changed)


@pytest.mark.parametrize("fault", ["dropped point", "wrong sign", "transposed", "shifted", "broken sum"])
def test_planted_faults_fail(library, fault):
    if fault == "transposed":
        family = families.depth_speed(6.0, 20.0)
        node = family.size - 1
        library = Library(family, Recipe(), bake_nodes(family, [node], Recipe()))
    broken = [f for f in check(planted(library, fault)) if f.broken]
    assert broken, fault


def test_check_and_bake_from_the_command_line(library, tmp_path, capsys):
    path = tmp_path / "disc.lwsp"
    assert (
        main(["lens", "bake", str(path), "--largest", "9", "--noise", "0.1", "--two-arrays", str(tmp_path / "t")]) == 0
    )
    assert (tmp_path / "t" / "points.npy").exists()
    assert main(["lens", "check", str(path), "--plot", str(tmp_path / "p.png")]) == 0
    assert (tmp_path / "p.png").stat().st_size > 500
    faulty = planted(load(path), "wrong sign")
    faulty.save(tmp_path / "faulty.lwsp")
    capsys.readouterr()
    assert main(["lens", "check", str(tmp_path / "faulty.lwsp"), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["broken"] > 0
    assert main(["lens", "check", str(tmp_path / "none.lwsp")]) == 2


@pytest.mark.parametrize(
    "options, text",
    [
        (["--family", "depth-speed", "--aperture", "hexagon"], "the family depth-speed has a round aperture"),
        (["--family", "cats-eye", "--blades", "5"], "the family cats-eye has a round aperture"),
        (["--cats-eye", "1"], "--cats-eye is not of the family depth"),
        (["--longest", "20"], "--longest is not of the family depth, which has no motion"),
        (["--family", "cats-eye", "--longest", "20"], "--longest is not of the family cats-eye"),
        (["--noise", "5"], "the default is 0.0025"),
        (["--family", "cats-eye", "--noise", "5"], "the default is 0.03"),
        (["--family", "cats-eye", "--cats-eye", "1.8"], "use 0 (none) or more, below 1.8 (closed)"),
    ],
)
def test_shapes_that_a_family_does_not_have_are_refused(tmp_path, capsys, options, text):
    assert main(["lens", "bake", str(tmp_path / "d.lwsp"), "--largest", "1", *options]) == 2
    error = capsys.readouterr().err
    assert text in error and error.strip().count("\n") == 0


def test_tools_write_over_nothing_that_they_read(library, tmp_path, capsys):
    path, shape = tmp_path / "d.lwsp", tmp_path / "shape.png"
    library.save(path)
    before = path.read_bytes()
    Image.fromarray(np.full((8, 8), 255, np.uint8)).save(shape)
    for words, text in (
        (["check", path, "--plot", path], f"lens check: --plot '{path}' is the file of LIBRARY, which would be lost"),
        (["check", path, "--aperture", shape, "--plot", shape], "is the file of --aperture"),
        (["bake", shape, "--aperture", shape], f"lens bake: LIBRARY '{shape}' is the file of --aperture"),
    ):
        assert main(["lens", *map(str, words)]) == 2
        error = capsys.readouterr().err
        assert text in error and error.strip().count("\n") == 0, error
    assert path.read_bytes() == before and Image.open(shape).size == (8, 8)


def test_a_library_is_not_checked_against_another_shape(library, tmp_path, capsys):
    library.save(tmp_path / "d.lwsp")
    Image.fromarray(np.full((8, 8), 255, np.uint8)).save(tmp_path / "shape.png")
    for shape, text in ((str(tmp_path / "shape.png"), "was baked for the aperture disc"), ("hexagon", "leave out")):
        assert main(["lens", "check", str(tmp_path / "d.lwsp"), "--aperture", shape]) == 2
        assert text in capsys.readouterr().err


def test_a_plot_that_cannot_be_written_is_told_before_the_check(library, tmp_path, capsys):
    library.save(tmp_path / "d.lwsp")
    argv = ["lens", "check", str(tmp_path / "d.lwsp"), "--plot", str(tmp_path / "no" / "p.png"), "--node", "9999"]
    assert main(argv) == 2 and "cannot write" in capsys.readouterr().err


def test_kernels_larger_than_a_panel_are_drawn_whole():
    corner = np.zeros((701, 701))
    corner[690:, 690:] = 1
    panel = panels(corner, corner, corner)[:, :PANEL, 0]
    rows, columns = np.nonzero(panel == 255)
    assert len(rows) and min(rows.min(), columns.min()) > PANEL // 2


def test_a_library_that_cannot_be_written_is_told_before_the_bake(tmp_path, monkeypatch, capsys):
    def bake(*_):
        raise AssertionError("nodes are baked")

    monkeypatch.setattr("lightwell.lens.bake_command.bake_nodes", bake)
    (tmp_path / "taken").mkdir()
    (tmp_path / "file").write_bytes(b"")
    for words, said in (
        ([tmp_path / "taken"], "a folder of that name exists"),
        ([tmp_path / "file/disc.lwsp"], "a file stands where a folder is expected"),
        ([tmp_path / "disc.lwsp", "--two-arrays", tmp_path / "file"], "a file stands where a folder is expected"),
    ):
        assert main(["lens", "bake", *map(str, words), "--largest", "9", "--noise", "0.1"]) == 2
        error = capsys.readouterr().err
        assert said in error and error.strip().count("\n") == 0


def test_the_shelf_keeps_what_it_baked():
    family = families.depth(7.0, noise=0.2)
    libraries = LibraryCache()
    made = libraries.library(family, Recipe())
    assert libraries.ensure(made, np.arange(family.size)) == family.size and libraries.ensure(made, np.arange(3)) == 0
    (path,) = [entry.path for entry in Store(default_folder()).entries() if entry.path.read_bytes() == made.tobytes()]
    assert LibraryCache().library(family, Recipe()).tobytes() == made.tobytes()
    path.write_bytes(b"LWSPgarbage")
    assert not LibraryCache().library(family, Recipe()).nodes, "a broken cache file is baked again"


def test_what_two_processes_bake_is_kept_together(tmp_path):
    """The second to write has not seen what the first wrote; a library that loses nodes is baked for ever."""
    family, store = families.depth(7.0, noise=0.2), Store(tmp_path)
    caches = [LibraryCache(store=store), LibraryCache(store=store)]
    made = [libraries.library(family, Recipe()) for libraries in caches]
    for libraries, library, node in zip(caches, made, (0, 1)):
        libraries.ensure(library, np.array([node]))
    assert {0, 1} <= {node for node, _ in LibraryCache(store=store).library(family, Recipe()).nodes}
