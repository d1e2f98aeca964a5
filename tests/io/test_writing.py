"""Files are whole, old or new, whatever happens to whoever writes them."""

from __future__ import annotations

import ast
import json
import os
from pathlib import Path

import pytest
from helpers.scripts import run_limited

import skmotionseg
from skmotionseg._utils.writing import (
    _store_names,
    check_output,
    replacing,
    replacing_path,
)

WRITERS = {
    "savefig",
    "savez",
    "savez_compressed",
    "savetxt",
    "imwrite",
    "VideoWriter",
    "write_text",
    "write_bytes",
    "tofile",
    "mkstemp",
    "NamedTemporaryFile",
}


def test_a_new_file_and_one_that_is_replaced(tmp_path):
    path = tmp_path / "file.bin"
    for content in (b"first", b"second"):
        with replacing(path) as file:
            file.write(content)
            assert not path.exists() or path.read_bytes() != content
        assert path.read_bytes() == content
        assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_what_fails_leaves_what_was_there(tmp_path, error):
    path = tmp_path / "file.bin"
    path.write_bytes(b"earlier")
    with pytest.raises(error), replacing(path) as file:
        file.write(b"half")
        raise error
    assert path.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_names_are_stored_where_folders_can_be_opened(tmp_path, monkeypatch):
    stored = []
    monkeypatch.setattr(os, "fsync", stored.append)
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(os, "name", "nt")
        _store_names(str(tmp_path))
    assert stored == []
    if os.name == "posix":
        _store_names(str(tmp_path))
        assert len(stored) == 1


def test_files_with_the_names_of_parts_are_nobodys(tmp_path):
    """Two writers of one target do not meet, and take nothing for theirs."""
    bystander = tmp_path / "file.part.bin"
    bystander.write_bytes(b"mine")
    path = tmp_path / "file.bin"
    with replacing(path) as first, replacing(path) as second:
        first.write(b"first")
        second.write(b"second")
    assert path.read_bytes() == b"first"  # which was finished last
    assert bystander.read_bytes() == b"mine"


@pytest.mark.skipif(os.name != "posix", reason="links and permissions are POSIX's")
def test_links_and_permissions_stay(tmp_path):
    target, link = tmp_path / "deep" / "file.bin", tmp_path / "link.bin"
    target.parent.mkdir()
    target.write_bytes(b"earlier")
    target.chmod(0o640)
    link.symlink_to(target)
    with replacing_path(link) as part:
        part.write_bytes(b"later")
    assert link.is_symlink()
    assert target.read_bytes() == b"later"
    assert target.stat().st_mode & 0o777 == 0o640


def test_a_name_as_long_as_names_may_be(tmp_path):
    path = tmp_path / ("n" * 251 + ".bin")
    with replacing(path) as file:
        file.write(b"content")
    assert path.read_bytes() == b"content"


def test_the_name_comes_after_the_content(tmp_path, monkeypatch):
    """On the disk, where a machine that fails would find it."""
    steps = []
    for name in ("fsync", "replace"):
        call = getattr(os, name)
        monkeypatch.setattr(
            os, name, lambda *a, name=name, call=call: steps.append(name) or call(*a)
        )
    with replacing(tmp_path / "file.bin") as file:
        file.write(b"content")
    assert steps[:2] == ["fsync", "replace"]


def test_what_is_no_file_is_not_written_over(tmp_path):
    with pytest.raises(ValueError, match="is not a file that could be written over"):
        check_output(tmp_path)


def test_every_writer_of_the_package_replaces():
    """Whoever writes a file gets its name from _utils/writing.py."""
    root = Path(skmotionseg.__file__).parent
    writers = set()
    for path in root.rglob("*.py"):
        tree = ast.parse(path.read_text())
        called = {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
        if called & WRITERS:
            writers.add(path.name)
            modules = {
                n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)
            }
            assert any(m and m.endswith("_utils.writing") for m in modules), path
    assert writers >= {"export.py", "_rendering.py", "console.py", "label_files.py"}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_writers_killed_at_any_line(tmp_path):
    pytest.importorskip("cv2", reason="needs opencv-python-headless")
    done = run_limited("killed_writers.py", tmp_path, seconds=240)
    assert done.returncode == 0, done.stderr[-2000:]
    for name, found in json.loads(done.stdout).items():
        assert found["wrong"] == [], name
        assert not found["same"], name
        assert found["old"] > 5, name
        assert found["new"] > 1, name
