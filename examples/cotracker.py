"""Segment the tracks of CoTracker, and keep the static ones.

CoTracker (github.com/facebookresearch/co-tracker) gives ``pred_tracks`` of shape
(1, n_frames, n_tracks, 2) and ``pred_visibility`` of shape (1, n_frames, n_tracks).
Write both to a file::

    cotracker = torch.hub.load("facebookresearch/co-tracker", "cotracker3_offline")
    pred_tracks, pred_visibility = cotracker(video, grid_size=30)
    np.savez(
        "cotracker.npz",
        pred_tracks=pred_tracks.cpu().numpy(),
        pred_visibility=pred_visibility.cpu().numpy(),
    )

and run this on it; without a file, on one of that layout with a synthetic scene::

    python examples/cotracker.py cotracker.npz
    python examples/cotracker.py

In a program that holds the tensors, no file is needed::

    X = pack_tracks(pred_tracks, pred_visibility, layout="frames_first")
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from skmotionseg import MotionSegmenter, save_motions, static_mask, unpack_tracks
from skmotionseg.datasets import load_tracks, make_rigid_motions


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, nargs="?", help="as CoTracker's (a scene)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="a file per motion")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.file or write_scene(Path(folder, "cotracker.npz"))
        X = load_tracks(path).data
    segmenter = MotionSegmenter(random_state=0).fit(X)
    report(X, segmenter)
    if arguments.out is not None:
        for path in save_motions(arguments.out, X, segmenter.labels_):
            print(f"wrote {path}")


def write_scene(path):
    """A file as of CoTracker: numbers where a point is not seen, too."""
    X, _ = make_rigid_motions(120, 8, 3, random_state=0)
    points, visibility = unpack_tracks(X)
    pred_tracks = np.nan_to_num(points).swapaxes(0, 1)[None].astype(np.float32)
    np.savez(path, pred_tracks=pred_tracks, pred_visibility=visibility.T[None])
    return path


def report(X, segmenter):
    n_tracks, n_frames = len(X), X.shape[1] // 2
    print(f"{n_tracks} tracks in {n_frames} frames, {segmenter.n_motions_} motions")
    for motion in range(segmenter.n_motions_):
        print(f"motion {motion}: {(segmenter.labels_ == motion).sum()} tracks")
    static = static_mask(X, segmenter.labels_, background=segmenter.background_)
    print(f"static points per frame: {static.sum(axis=0).mean():.1f}")


if __name__ == "__main__":
    main()
