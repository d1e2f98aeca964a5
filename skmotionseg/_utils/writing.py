"""Files that are there whole or not at all, and could be written at all."""

from __future__ import annotations

import os
import secrets
import shutil
from contextlib import contextmanager
from pathlib import Path

# Names of the files of motions' tracks (see :func:`motion_file`).
MOTION_FILES = ("motion_*.npz", "no_motion.npz")


def check_output(path, endings=None):
    """Refuse a file that could not be written, before any work.

    Parameters
    ----------
    path : Path or None
    endings : sequence of str, optional
        Those it may have.

    Raises
    ------
    ValueError
        If it has another ending, or something is there that is no file.
    FileNotFoundError, PermissionError
        If its folder does not exist, or may not be written to.
    """
    if path is None:
        return
    if endings is not None and path.suffix.lower() not in endings:
        raise ValueError(f"output files end in {' or '.join(endings)}; got {path.name}")
    check_folder_of(path)
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is not a file that could be written over")


def check_apart(source, outputs):
    """Refuse to write over what is read, or twice to one file, before any work.

    Parameters
    ----------
    source : Path
        A file or a folder that is read.
    outputs : dict of str to (Path or None)
        What is written, by the name of the option that says where to.

    Raises
    ------
    ValueError
    """
    known = {os.path.realpath(source): "the input"}
    for option, path in outputs.items():
        if path is not None:
            place = os.path.realpath(path)
            if place in known:
                raise ValueError(f"{option} and {known[place]} are the same: {path}")
            known[place] = option


def check_folder_of(path):
    """Refuse a path whose folder does not exist, or is closed; None will do."""
    if path is None:
        return
    folder = path.absolute().parent
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder to write {path} to")
    folder = path if path.is_dir() else folder
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(f"{folder} may not be written to (permission denied)")


def check_output_folder(folder):
    """Refuse a folder that could not be made or written to; None will do."""
    check_folder_of(folder)
    if folder is not None and folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is not a folder that could be written to")


def motion_file(motion):
    """Name of the file of a motion's tracks; of those of none, if it is negative."""
    return f"motion_{motion}.npz" if motion >= 0 else "no_motion.npz"


def check_kept(folder, others):
    """Refuse a folder in which motions would be written over other files.

    Parameters
    ----------
    folder : Path
        Need not be there.
    others : dict of str to (Path or None)
        What must stay, by what it is.

    Raises
    ------
    ValueError
    """
    real = os.path.realpath(folder)
    for name, path in others.items():
        if path is None:
            continue
        place, file = os.path.split(os.path.realpath(path))
        if place == real and any(map(Path(file).match, MOTION_FILES)):
            raise ValueError(
                f"motions in {folder} may be written over {name}, {path}: name another "
                "folder"
            )


def check_stale(folder, names):
    """Refuse a folder that holds motions of another segmentation, which would stay.

    Parameters
    ----------
    folder : Path
        Need not be there.
    names : container of str
        Of the files that new ones take the place of.

    Raises
    ------
    FileExistsError
    """
    present = [path for pattern in MOTION_FILES for path in folder.glob(pattern)]
    stale = sorted(path.name for path in present if path.name not in names)
    if stale:
        raise FileExistsError(
            f"{folder} holds {', '.join(stale)} of another segmentation: remove it, or "
            "name another folder"
        )


@contextmanager
def replacing(path):
    """A binary file beside the target, put in its place once it is whole."""
    with replacing_path(path) as part, part.open("wb") as file:
        yield file


@contextmanager
def replacing_path(path):
    """As :func:`replacing`, for writers that open a file themselves.

    The path has the target's ending, which tells such writers the format. If writing
    fails, it is removed and the target stays what it was. If the process is killed or
    the machine fails, the target is what it was or what it was to be.

    Parameters
    ----------
    path : Path
        A link stays one: the file that it leads to is replaced.
    """
    target = Path(os.path.realpath(path))
    # A name that no other writer, of this target or another, has or will have.
    part = target.with_name(f".skmotionseg-{secrets.token_hex(8)}{target.suffix}")
    try:
        yield part
        if target.exists():
            shutil.copymode(target, part)
        _store(part)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
    _store_names(target.parent)


def _store(path):
    """Wait until a file's content is on the disk: its name must not come first."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _store_names(folder):
    """Wait until the names in a folder are on the disk, where systems can tell."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
