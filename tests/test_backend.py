"""The door to Mitsuba: which files of which folders it may load."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lightwell.backend import ACTIVE, aligned, cure, dr, mi, two_threads, upload_floats
from lightwell.core.image_io import write_picture

PROGRAM = """
import sys; sys.path[:] = sys.argv[1:]
from lightwell.backend import mi
print(mi.load_dict({"type": "diffuse"}).class_name(), mi.file_resolver())
"""


def test_plugins_of_the_working_folder_are_not_loaded(tmp_path):
    (tmp_path / "plugins").mkdir()
    for suffix in (".so", ".dylib", ".dll"):
        (tmp_path / "plugins" / f"diffuse{suffix}").write_text("a stranger's code")
    path = [str(Path(__file__).parents[1]), *filter(None, sys.path)]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *path], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.startswith("SmoothDiffuse"), done.stderr
    assert str(tmp_path) not in done.stdout


@pytest.mark.parametrize(
    "system, processor, what",
    [
        ("linux", "x86_64", "pip install karellen-llvm-core"),
        ("linux", "aarch64", "apt-get install llvm-18"),
        ("darwin", "arm64", "brew install llvm"),
        ("win32", "AMD64", "LLVM-C.dll"),
    ],
)
def test_the_cure_of_each_platform_is_one_line_and_in_the_docs(system, processor, what):
    line = cure(system, processor)
    assert what in line and "\n" not in line and "DRJIT_LIBLLVM_PATH" in line
    table = (Path(__file__).parents[1] / "docs/tutorials/install.md").read_text()
    assert (what.removeprefix("pip install ") if system != "win32" else "the LLVM installer") in table


def test_kernels_are_the_same_for_arrays_of_every_alignment():
    """Dr.Jit writes the alignment of the memory that it wraps into its kernels."""
    memory = aligned(np.zeros(64), np.float32).view(np.uint8)
    hashes = {}
    for upload in (upload_floats, mi.Float):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            for begin in (0, 4, 16, 36):
                dr.eval(upload(memory[begin : begin + 64].view(np.float32)) * 3)
            hashes[upload] = {kernel["hash"] for kernel in dr.kernel_history() if "hash" in kernel}
    assert len(hashes[upload_floats]) == 1
    # Without the copy they differ, on a processor.
    assert len(hashes[mi.Float]) > 1 or not ACTIVE.variant.startswith("llvm")


def test_aligned_copies_are_copies():
    for shape in ((0,), (3,), (5, 2)):
        original = np.arange(np.prod(shape), dtype=np.float64).reshape(shape)
        copy = aligned(original, np.float32)
        assert copy.dtype == np.float32 and (not copy.size or copy.ctypes.data % 64 == 0)
        assert np.array_equal(copy, original) and not np.shares_memory(copy, original)


def test_pictures_are_written_and_read_with_one_thread(tmp_path):
    """Mitsuba's own writer and reader of EXR files wait for ever there."""
    path, picture = tmp_path / "picture.exr", np.full((4, 6, 3), 0.5, np.float32)
    before = dr.thread_count()
    dr.set_thread_count(1)
    try:
        write_picture(path, picture)
        assert dr.thread_count() == 1
        with two_threads():
            assert np.array_equal(np.array(mi.Bitmap(str(path))), picture)
    finally:
        dr.set_thread_count(before)
