"""Files as renderers write them, conventions, and every mistake that a user can make: one line, exit code 2."""

import json

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from lightwell.cli import main
from lightwell.exr import decoding
from lightwell.lens import Camera, LensError, aperture, exr, frames
from lightwell.lens.conventions import Motion, guess_motion, planar_depth
from tests.same_process import SameProcess

H, W = 48, 64


def write_exr(path, channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {k: np.ascontiguousarray(v, np.float32) for k, v in channels.items()}).write(str(path))
    return str(path)


def colour(prefix=""):
    ramp = np.linspace(0, 1, W) * np.ones((H, 1))
    return {prefix + "R": ramp, prefix + "G": 0.5 * ramp, prefix + "B": 1 - ramp, prefix + "A": np.ones((H, W))}


def depth(value=5.0):
    return np.where(np.arange(W) < W // 2, 1.0, value) * np.ones((H, 1))


@pytest.fixture
def here(monkeypatch):
    """Pictures are decoded in this process; those of the other tests, and damaged ones, in another."""
    monkeypatch.setattr(decoding, "Worker", SameProcess)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "prefix, name, kind",
    [("", "Z", "planar"), ("ViewLayer.Combined.", "ViewLayer.Depth.Z", "planar"), ("img.", "dd.T", "ray-from-near"),
     ("", "depth.Z", "planar"), ("rgba.", "Depth.V", "planar")],
)  # fmt: skip
def test_channels_are_found_by_their_common_names(tmp_path, prefix, name, kind):
    frame = frames.read(write_exr(tmp_path / "f.exr", colour(prefix) | {name: depth()}))
    assert (
        frame.rgba.shape == (H, W, 4) and frame.depth[0, -1] == 5 and frame.depth_kind == kind and frame.motion is None
    )


def test_blender_vectors_point_backwards_and_up(tmp_path):
    vectors = {f"ViewLayer.Vector.{c}": np.full((H, W), v) for c, v in zip("XYZW", (1, 2, 3, 4))}
    channels = colour("ViewLayer.Combined.") | {"ViewLayer.Depth.Z": depth()} | vectors
    frame = frames.read(write_exr(tmp_path / "f.exr", channels))
    motion = frame.motion_kind.pixels(frame.motion, W, H)
    assert motion[0, 0] == pytest.approx([-3, 4])


def test_vectors_of_nuke_point_forwards_and_up(tmp_path):
    vectors = {"forward.u": np.full((H, W), 3.0), "forward.v": np.full((H, W), 4.0)}
    frame = frames.read(write_exr(tmp_path / "f.exr", colour() | {"Z": depth()} | vectors))
    assert frame.motion_kind.pixels(frame.motion, W, H)[0, 0] == pytest.approx([3, -4])


def test_ray_depth_of_mitsuba_becomes_planar():
    # A plane at z = 3, near plane 0.01, 60°: 2.990 in the middle.
    width = 101
    y, x = np.mgrid[:width, :width]
    focal = width / (2 * np.tan(np.deg2rad(30)))
    cosine = 1 / np.sqrt(1 + ((x - 50) ** 2 + (y - 50) ** 2) / focal**2)
    camera = Camera(focus=100.0, focal=0.05, sensor=2 * 0.05 * 100 / 99.95 * np.tan(np.deg2rad(30)))
    z = planar_depth((3 - 0.01) / cosine, "ray-from-near", camera, width, (width / 2, width / 2), 0.01)
    assert np.abs(z - 3).max() < 1e-3
    assert np.isinf(planar_depth(np.zeros((2, 2)), "ray", camera, 2, (1, 1)))[0, 0]
    assert planar_depth(np.full((1, 1), 0.25), "inverse", camera, 1, (0, 0)) == 4
    assert np.isinf(planar_depth(np.full((1, 1), 1e10), "planar", camera, 1, (0, 0)))


@pytest.mark.parametrize("truth", [Motion(), Motion("uv", False, True), Motion("ndc", True, False)])
def test_convention_of_motion_is_found_by_warping(truth):
    rng = np.random.default_rng(0)
    texture = rng.random((60, 80, 3)).repeat(2, 0).repeat(2, 1)[:100, :140]
    following = np.roll(texture, (5, 8), (0, 1))
    scale = {"pixels": (1, 1), "ndc": (70, 50), "uv": (140, 100)}[truth.unit]
    sign = -1 if truth.backward else 1
    raw = np.zeros((100, 140, 2))
    raw[10:80, 10:120] = [8 * sign / scale[0], 5 * sign * (-1 if truth.y_up else 1) / scale[1]]
    found, errors = guess_motion(raw, texture, following)
    assert np.allclose(found.pixels(raw, 140, 100), truth.pixels(raw, 140, 100)) and len(errors) == 12


def test_given_stereo_file(given):
    found = exr.read(given / "beachball" / "multipart.0001.exr", "left")
    assert "depth_left.Z" in found.names and found.display[2:] == (2048, 1556)
    frame = frames.read(given / "beachball" / "multipart.0001.exr")
    assert frame.rgba.shape == (1556, 2048, 4) and frame.motion is not None
    with pytest.raises(LensError, match="has no view 'up'; it has right, left"):
        exr.read(given / "beachball" / "multipart.0001.exr", "up")


def test_given_motion_vectors_are_forward_pixels(given):
    a, b = (frames.read(given / "beachball" / f"multipart.000{i}.exr") for i in (1, 2))
    found, errors = guess_motion(a.motion, a.rgba, b.rgba)
    assert found == Motion("pixels", backward=False, y_up=True)
    assert errors[found] < 0.75 * errors[Motion("pixels", backward=True, y_up=True)]


def test_given_deep_file_is_sorted_into_layers_without_seams(given):
    frame = frames.read(given / "deep" / "Balls.exr", layers=2)
    assert len(frame.behind) == 1
    single = frames.read(given / "deep" / "Balls.exr", layers=1)
    front, (back, _) = frame.rgba, frame.behind[0]
    over = front + (1 - front[..., 3:]) * back
    assert np.abs(over - single.rgba).max() < 1e-3


def test_one_frame_from_the_command_line(tmp_path, capsys):
    source = write_exr(tmp_path / "f.exr", colour() | {"Z": depth()})
    out = tmp_path / "o.exr"
    assert main(["lens", source, "-o", str(out), "--focus", "1m", "--fstop", "1.4", "--focal", "50mm", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["largest_px"] > 1 and facts["layers"] in (1, 2)
    made = exr.read(out).names
    assert set(made) == set("RGBA") and np.isfinite(made["R"]).all()
    assert main(["lens", source, "-o", str(out), "--focus-at", "60,10", "--json", "--overscan", "4"]) == 0
    assert json.loads(capsys.readouterr().out)["focus_m"] == 5 and exr.read(out).names["R"].shape == (H - 8, W - 8)


def test_overscan_leaves_a_whole_picture_of_the_same_blur(tmp_path, capsys):
    source = write_exr(tmp_path / "f.exr", colour() | {"Z": depth()})
    found = []
    for crop in (0, 8):
        out = tmp_path / f"{crop}.exr"
        assert main(["lens", source, "-o", str(out), "--focus", "1m", "--overscan", str(crop), "--json"]) == 0
        made = exr.read(out)
        assert made.window == made.display == (0, 0, W - 2 * crop, H - 2 * crop)
        found.append(json.loads(capsys.readouterr().out)["largest_px"])
    # The sensor is as wide as the picture that is left.
    assert found[1] / found[0] == pytest.approx((W - 16) / W, rel=1e-2)


def test_overscan_beyond_the_display_window(tmp_path):
    box = np.array([-6, -6], np.int32), np.array([W - 7, H - 7], np.int32)
    shown = np.array([0, 0], np.int32), np.array([W - 13, H - 13], np.int32)
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    header |= {"dataWindow": box, "displayWindow": shown}
    planes = {k: np.ascontiguousarray(v, np.float32) for k, v in (colour() | {"Z": depth()}).items()}
    OpenEXR.File(header, planes).write(str(tmp_path / "f.exr"))
    for crop, window in ((2, (-4, -4, W - 4, H - 4)), (6, (0, 0, W - 12, H - 12))):
        out = tmp_path / f"{crop}.exr"
        argv = ["lens", str(tmp_path / "f.exr"), "-o", str(out), "--focus", "1m", "--overscan", str(crop)]
        assert main(argv) == 0
        made = OpenEXR.File(str(out)).parts[0].header
        low, high = (tuple(int(v) for v in edge) for edge in made["dataWindow"])
        assert (*low, high[0] - low[0] + 1, high[1] - low[1] + 1) == window
        assert exr.read(out).display == (0, 0, W - 12, H - 12)


def test_grey_pictures_of_16_bits_and_palettes_keep_their_values(tmp_path):
    Image.fromarray(np.full((H, W), 32896, np.uint16)).save(tmp_path / "f.png")
    grey = np.full((H, W), 20, np.uint8)
    grey[:, 9:] = 240
    Image.fromarray(grey).convert("RGB").convert("P", palette=Image.Palette.ADAPTIVE).save(tmp_path / "d.png")
    frame = frames.read(tmp_path / "f.png", depth_file=tmp_path / "d.png", depth_range=(0, 255))
    assert np.allclose(frame.depth, grey) and frame.rgba[0, 0, 0] == pytest.approx(0.216, abs=1e-3)
    # Half open, and not white, on the right.
    Image.fromarray(np.where(np.arange(40) < 20, 65535, 32768).astype(np.uint16) * np.ones((40, 1), np.uint16)).save(
        tmp_path / "mask.png"
    )
    mask = aperture.read_mask(tmp_path / "mask.png")
    assert mask(np.array([0.4]), np.array([0.0]))[0] == pytest.approx(0.5, abs=0.01)


def test_png_with_a_depth_picture(tmp_path):
    Image.fromarray(np.full((H, W, 3), 128, np.uint8)).save(tmp_path / "f.png")
    Image.fromarray((depth() / 5 * 65535).astype(np.uint16)).save(tmp_path / "d.png")
    argv = ["lens", str(tmp_path / "f.png"), "-o", str(tmp_path / "o.png"), "--focus", "1m", "--depth-file"]
    assert main([*argv, str(tmp_path / "d.png"), "--depth-range", "0,5"]) == 0
    pixels = np.asarray(Image.open(tmp_path / "o.png"))
    assert np.abs(pixels.astype(int) - 128).max() <= 1


def test_a_sequence_with_motion_found_by_itself(tmp_path, capsys):
    rng = np.random.default_rng(1)
    texture = rng.random((H // 2, W)).repeat(2, 0)
    for i in range(3):
        plane = np.roll(texture, 4 * i, 1)
        vectors = {"motion.u": np.full((H, W), 4.0), "motion.v": np.zeros((H, W))}
        write_exr(tmp_path / f"s.{i:04}.exr", {c: plane for c in "RGB"} | {"Z": depth()} | vectors)
    argv = ["lens", str(tmp_path / "s.####.exr"), "-o", str(tmp_path / "o.####.exr"), "--focus", "2m", "--json"]
    assert main([*argv, "--frames", "0-2", "--motion", "auto", "--layers", "1"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert len(facts) == 3 and all(f["longest_px"] == pytest.approx(2) for f in facts)
    assert len(list(tmp_path.glob("o.*.exr"))) == 3
    # A frame by itself is what it is within the sequence.
    alone = [*argv[:3], str(tmp_path / "alone.####.exr"), *argv[4:], "--frames", "1-1", "--motion", "pixels"]
    assert main([*alone, "--layers", "1"]) == 0
    one, other = (exr.read(tmp_path / f"{name}.0001.exr").names for name in ("o", "alone"))
    assert all(np.array_equal(one[channel], other[channel]) for channel in "RGBA")


def test_a_sequence_of_still_frames_and_depth_by_another_name(tmp_path, capsys):
    rng = np.random.default_rng(1)
    texture = rng.random((H // 2, W)).repeat(2, 0)
    # Nothing moves before frame 2.
    for i, (at, speed) in enumerate(((0, 0), (0, 4), (4, 4))):
        vectors = {"motion.u": np.full((H, W), speed), "motion.v": np.zeros((H, W))}
        planes = {c: np.roll(texture, at, 1) for c in "RGB"} | {"how far": depth()} | vectors
        write_exr(tmp_path / f"s.{i}.exr", planes)
    argv = ["lens", str(tmp_path / "s.#.exr"), "-o", str(tmp_path / "o.#.exr"), "--focus", "2m", "--json"]
    assert main([*argv, "--frames", "0-2", "--motion", "auto", "--depth-channel", "how far", "--layers", "1"]) == 0
    assert [f["longest_px"] for f in json.loads(capsys.readouterr().out)] == pytest.approx([0, 2, 2])


def test_a_sequence_with_depth_files_in_a_folder_with_a_hash(tmp_path, capsys):
    folder = tmp_path / "C#"
    folder.mkdir()
    for i in (7, 8):
        Image.fromarray(np.full((H, W, 3), 128, np.uint8)).save(folder / f"f.{i:02}.png")
        Image.fromarray(np.full((H, W), i, np.uint8)).save(folder / f"d.{i:02}.png")
    argv = ["lens", str(folder / "f.##.png"), "-o", str(folder / "o.##.png"), "--focus", "7m", "--json"]
    argv += ["--depth-file", str(folder / "d.##.png"), "--depth-range", "0,255"]
    assert main([*argv, "--frames", "7-8"]) == 0
    first, second = (f["largest_px"] for f in json.loads(capsys.readouterr().out))
    assert first == 0 and second > 0 and (folder / "o.08.png").exists()
    # A file whose name has the character is no sequence.
    one = ["lens", str(folder / "f.07.png"), "-o", str(folder / "o.png"), "--depth-file", str(folder / "d.07.png")]
    assert main([*one, "--depth-range", "0,255", "--focus", "7m"]) == 0


GOOD = ["--focus", "2m"]


def test_no_input_is_written_over(tmp_path, capsys, monkeypatch):
    """Also by a link, another spelling, the file of a later frame, and files beside the frame."""
    monkeypatch.chdir(tmp_path)
    write_exr("f.exr", colour() | {"Z": depth()})
    (tmp_path / "link.exr").symlink_to("f.exr")
    (tmp_path / "folder").mkdir()
    for name in ("p.png", "d.png", "shape.png", "s.1.png", "s.02.png"):
        Image.fromarray(np.full((H, W), 200, np.uint8)).save(name)
    near = ["--depth-file", "d.png", "--depth-range", "1,5"]
    before = {path: path.read_bytes() for path in tmp_path.glob("*.*")}
    for argv, text in (
        (["f.exr", "-o", "f.exr"], "-o 'f.exr' is the file of FRAME, which would be lost"),
        (["f.exr", "-o", "folder/../f.exr"], "-o 'folder/../f.exr' is the file of FRAME ('f.exr')"),
        (["f.exr", "-o", str(tmp_path / "f.exr")], "is the file of FRAME ('f.exr')"),
        (["link.exr", "-o", "f.exr"], "-o 'f.exr' is the file of FRAME ('link.exr')"),
        (["f.exr", "-o", "link.exr"], "-o 'link.exr' is the file of FRAME ('f.exr')"),
        (["p.png", "-o", "d.png", *near], "-o 'd.png' is the file of --depth-file,"),
        (["p.png", "-o", "shape.png", *near, "--aperture", "shape.png"], "is the file of --aperture,"),
        (["s.#.png", "-o", "s.#.png", *near, "--frames", "1-1"], "-o 's.1.png' is the file of FRAME,"),
        (["s.##.png", "-o", "s.#.png", "--depth-file", "s.#.png", "--frames", "1-2"], "is the file of --depth-file"),
    ):
        code = main(["lens", *argv, *GOOD])
        error = capsys.readouterr().err
        assert code == 2 and text in error and error.strip().count("\n") == 0, error
        assert "give another file to write" in error
    assert {path: path.read_bytes() for path in tmp_path.glob("*.*")} == before


@pytest.mark.usefixtures("here")
def test_a_depth_file_of_several_views_gives_the_view_that_is_asked_for(tmp_path, capsys):
    def part(view, value):
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "view": view}
        return OpenEXR.Part(header, {"Z": np.full((H, W), value, np.float32)}, f"depth_{view}")

    stereo = tmp_path / "d.exr"
    OpenEXR.File([part("left", 1), part("right", 2)]).write(str(stereo))
    Image.fromarray(np.full((H, W, 3), 200, np.uint8)).save(tmp_path / "right.png")
    for view, expected in ((None, 1), ("left", 1), ("right", 2)):
        assert frames.read(tmp_path / "right.png", view, depth_file=stereo).depth.max() == expected
    one = write_exr(tmp_path / "one.exr", {"Z": depth()})
    with pytest.raises(LensError, match="has no view 'right'; it has none"):
        frames.read(tmp_path / "right.png", "right", depth_file=one)
    argv = ["lens", str(tmp_path / "right.png"), "-o", str(tmp_path / "o.png"), *GOOD, "--view", "right"]
    assert main([*argv, "--depth-file", str(tmp_path / "right.png"), "--depth-range", "1,2"]) == 2
    assert "is no EXR and has no view 'right'; leave out --view" in capsys.readouterr().err


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "channels, extra, text",
    [
        (colour(), GOOD, "has no depth"),
        ({"Z": depth()}, GOOD, "has no colour"),
        (colour() | {"Z": depth()}, [], "--focus"),
        (colour() | {"Z": depth()}, ["--focus", "2"], None),
        (colour() | {"Z": depth()}, ["--focus", "two"], "is not a length"),
        (colour() | {"Z": depth()}, [*GOOD, "--focal", "0mm"], "focal length 0 mm; give one above 0"),
        (colour() | {"Z": depth()}, ["--focus", "4cm"], "is not beyond the focal length"),
        (colour() | {"Z": depth()}, [*GOOD, "--fstop", "0"], "f-number 0"),
        (colour() | {"Z": depth()}, [*GOOD, "--fstop", "nan"], "fstop is nan"),
        (colour() | {"Z": depth()}, [*GOOD, "--sensor", "0mm"], "sensor width"),
        (colour() | {"Z": depth()}, [*GOOD, "--shutter", "-1"], "shutter -1"),
        (colour() | {"Z": depth()}, [*GOOD, "--layers", "0"], "0 layers"),
        (colour() | {"Z": depth()}, [*GOOD, "--preset", "fast"], "choose default, best, paper"),
        (colour() | {"Z": depth()}, [*GOOD, "--solver", "magic"], "no solver"),
        (colour() | {"Z": depth()}, [*GOOD, "--aperture", "none.png"], "no aperture picture"),
        (colour() | {"Z": depth()}, [*GOOD, "--blades", "2"], "2 blades"),
        (colour() | {"Z": depth()}, [*GOOD, "--blades", "6", "--aperture", "pentagon"], "pentagon has no 6 blades"),
        (colour() | {"Z": depth()}, [*GOOD, "--blades", "6", "--aperture", "star.png"], "star.png has no 6 blades"),
        (colour() | {"Z": depth()}, [*GOOD, "--blade-angle", "9"], "turns polygons, not --aperture disc"),
        (colour() | {"Z": depth()}, [*GOOD, "--focus-at", "9,9"], "leave out one of them"),
        (colour() | {"Z": depth()}, [*GOOD, "--near", "0.1"], "--near is for depth of the kind ray-from-near"),
        (
            colour() | {"Z": depth(), "forward.u": depth(), "forward.v": depth()},
            [*GOOD, "--motion", "uv backward forward"],
            "--motion says backward and forward",
        ),
        (colour() | {"Z": depth()}, [*GOOD, "--depth-channel", "Y"], "it has A, B, G, R, Z"),
        (colour() | {"Z": depth()}, [*GOOD, "--motion-channels", "u"], "joined by a comma"),
        (colour() | {"Z": depth()}, [*GOOD, "--motion", "auto"], "has no motion vectors"),
        (colour() | {"Z": depth()}, [*GOOD, "--depth", "log"], "depth convention"),
        (colour() | {"Z": depth()}, ["--focus-at", "900,1"], "outside the frame"),
        (colour() | {"Z": np.full((H, W), 1e10)}, ["--focus-at", "9,9"], "points at the sky"),
        (colour() | {"Z": np.full((H, W), np.nan)}, GOOD, "no pixel has finite colour"),
        (colour() | {"Z": depth()}, [*GOOD, "--cats-eye", "3"], "cat's eye of strength 3"),
        (colour() | {"Z": depth()}, [*GOOD, "--overscan", "40"], "leaves nothing"),
        (colour() | {"Z": depth()}, [*GOOD, "--frames", "1-2"], "needs ####"),
        (colour() | {"Z": depth()}, [*GOOD, "--largest", "0"], "must be above 0"),
        (colour() | {"Z": depth()}, [*GOOD, "--depth-range", "1,20"], "is for a PNG of --depth-file"),
    ],
)
def test_mistakes_are_one_line_with_a_cure(tmp_path, capsys, channels, extra, text):
    source = write_exr(tmp_path / "f.exr", channels)
    code = main(["lens", source, "-o", str(tmp_path / "o.exr"), *extra])
    error = capsys.readouterr().err
    if text is None:
        assert code == 0
        return
    assert code == 2 and text in error and error.strip().count("\n") == 0, error


def test_files_that_cannot_be_read(tmp_path, capsys):
    (tmp_path / "bad.exr").write_bytes(b"\x76\x2f\x31\x01garbage")
    (tmp_path / "bad.png").write_bytes(b"nothing")
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(tmp_path / "black.png")
    source = write_exr(tmp_path / "f.exr", colour() | {"Z": depth()})
    out = ["-o", str(tmp_path / "o.exr"), *GOOD]
    png = ["--depth-file", str(tmp_path / "black.png")]
    for argv, text in (
        ([str(tmp_path / "none.exr"), *out], "no file"),
        ([str(tmp_path / "bad.exr"), *out], "cannot read"),
        ([str(tmp_path / "bad.png"), *out], "cannot read"),
        ([source, *out, "--aperture", str(tmp_path / "bad.png")], "cannot read aperture"),
        ([source, *out, "--aperture", str(tmp_path / "black.png")], "is black everywhere"),
        ([source, "-o", str(tmp_path / "o.jpg"), *GOOD], "must end in .exr or .png"),
        ([source, *GOOD], "no picture to write"),
        ([source, "-o", str(tmp_path / "no" / "o.exr"), *GOOD], "cannot write"),
        # Before any work: the frame is not even read.
        ([str(tmp_path / "bad.exr"), "-o", str(tmp_path / "no" / "o.exr"), *GOOD], "cannot write"),
        ([str(tmp_path / "black.png"), *out, "--motion-channels", "u,v"], "has no channels of motion"),
        ([str(tmp_path / "black.png"), *out, *png, "--depth-range", "1,2", "--depth-channel", "Z"], "no channel 'Z'"),
    ):
        assert main(["lens", *argv]) == 2
        error = capsys.readouterr().err
        assert text in error and error.strip().count("\n") == 0, error


def test_given_mask_makes_its_shape(given, tmp_path):
    source = write_exr(tmp_path / "f.exr", colour() | {"Z": depth()})
    mask = str(given / "apertures" / "hexagon-10.png")
    assert (
        main(["lens", source, "-o", str(tmp_path / "o.exr"), "--focus", "1m", "--fstop", "4", "--aperture", mask]) == 0
    )
