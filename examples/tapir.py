"""Segment the tracks of TAPIR.

TAPIR (github.com/google-deepmind/tapnet) gives ``tracks`` of shape
(1, n_tracks, n_frames, 2) and two logits of shape (1, n_tracks, n_frames): that a point
is occluded, and that it is not where it is said to be. A point is seen if

    (1 - sigmoid(occlusion)) * (1 - sigmoid(expected_dist)) > 0.5

which is what reading a file with both does. Write them as they are::

    outputs = model(frames, query_points)
    np.savez(
        "tapir.npz",
        tracks=outputs["tracks"],
        occlusion=outputs["occlusion"],
        expected_dist=outputs["expected_dist"],
    )

or ``tracks`` and the ``visibles`` of TAPIR's demos, and run this on the file; without
one, on one of that layout with a synthetic scene::

    python examples/tapir.py tapir.npz
    python examples/tapir.py

Mind that TAPIR's tracks are in pixels of the video as it was resized for it, often to
256 x 256. TAPIR's demos scale them to the video's own size; otherwise do so first::

    tracks = np.asarray(outputs["tracks"]) * [width / 256, height / 256]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg.datasets import load_tracks, make_rigid_motions


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, nargs="?", help="as TAPIR's (a scene)")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.file or write_scene(Path(folder, "tapir.npz"))
        X = load_tracks(path).data
    segmenter = MotionSegmenter(random_state=0).fit(X)
    unseen = np.isnan(X).mean()
    print(f"{len(X)} tracks in {X.shape[1] // 2} frames, {unseen:.1%} unseen")
    print(f"{segmenter.n_motions_} motions")
    for motion in range(segmenter.n_motions_):
        print(f"motion {motion}: {(segmenter.labels_ == motion).sum()} tracks")


def write_scene(path):
    """A file as of TAPIR: logits, and numbers where a point is not seen, too."""
    X, _ = make_rigid_motions(120, 8, 3, random_state=0)
    points, visibility = unpack_tracks(X)
    logits = np.where(visibility, -4.0, 4.0)[None].astype(np.float32)
    np.savez(
        path,
        tracks=np.nan_to_num(points)[None].astype(np.float32),
        occlusion=logits,
        expected_dist=logits - 1,
    )
    return path


if __name__ == "__main__":
    main()
