"""A digest of the labels of all methods, to tell whether a change moved any of them.

    python -m benchmarks.label_digest --data DIR [--jobs 2] [--write FILE]

Run it before and after a change that should leave every label what it is, and compare
the last lines. ``--write`` also keeps a line per sequence and method, so that ``diff``
says which moved. ``--data`` defaults to the environment variable ``SKMOTIONSEG_DATA``.

One digest covers the number of motions known and unknown, the paper's selection with
each fusion, the rules it is compared with, and the plain pipeline, with seed 0, on
KT3DMoSeg, MTPV62, Hopkins12 and every fourth sequence of Hopkins155; and one clip of
KT3DMoSeg with all its tracks, some of which are fitted and the others placed.
"""

from __future__ import annotations

import argparse
import hashlib
import os
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from skmotionseg import MotionSegmenter, make_motion_pipeline

from .sensitivity import LOADERS, THINNING

# In this order: the digest is of all labels one after another.
DATASETS = ("KT3DMoSeg", "MTPV62", "Hopkins12", "Hopkins155")
METHODS = {
    "known": lambda n: MotionSegmenter(n, random_state=0),
    "unknown": lambda n: MotionSegmenter(random_state=0),
    **{
        f"ncre-{fusion}": lambda n, fusion=fusion: MotionSegmenter(
            selection="ncre", fusion=fusion, random_state=0
        )
        for fusion in ("kernel_addition", "coreg", "subset")
    },
    "eigengap": lambda n: MotionSegmenter(selection="eigengap", random_state=0),
    "self_tuning": lambda n: MotionSegmenter(selection="self_tuning", random_state=0),
    "pipeline": lambda n: make_motion_pipeline(n_clusters=n, random_state=0),
}


def digest_of(name: str, X: np.ndarray, n_motions: int, method: str) -> str:
    """A line that names a sequence, a method and the digest of its labels."""
    labels = METHODS[method](n_motions).fit_predict(X)
    content = np.ascontiguousarray(labels, dtype=np.int64).tobytes()
    return f"{name} {method} {hashlib.sha256(content).hexdigest()[:16]}"


def sequences(folder: Path):
    """Yield names, tracks and numbers of motions, then one clip with all its tracks."""
    clips = {}
    for dataset in DATASETS:
        clips[dataset] = LOADERS[dataset](folder / dataset)[:: THINNING.get(dataset, 1)]
        for clip in clips[dataset]:
            yield f"{dataset}/{clip.name}", clip.data, count_of(clip)
    clip = clips["KT3DMoSeg"][0]
    yield f"KT3DMoSeg/{clip.name}/all", clip.dense_data, count_of(clip)


def count_of(clip) -> int:
    return len(np.unique(clip.target[clip.target >= 0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--data", type=Path, default=os.environ.get("SKMOTIONSEG_DATA"), help="folder"
    )
    parser.add_argument("--jobs", type=int, default=1, help="fits at a time")
    parser.add_argument("--write", type=Path, help="file for a line per label array")
    arguments = parser.parse_args()
    if arguments.data is None:
        parser.error("--data, or SKMOTIONSEG_DATA, must say where the sequences are")
    lines = Parallel(n_jobs=arguments.jobs, batch_size=1)(
        delayed(digest_of)(*sequence, method)
        for sequence in sequences(Path(arguments.data))
        for method in METHODS
    )
    content = "".join(f"{line}\n" for line in lines)
    if arguments.write:
        arguments.write.write_text(content, encoding="utf-8")
    print(f"{len(lines)} label arrays: {hashlib.sha256(content.encode()).hexdigest()}")


if __name__ == "__main__":
    main()
