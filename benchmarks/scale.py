"""Many tracks, and many frames."""

from __future__ import annotations

from skmotionseg import MotionSegmenter
from skmotionseg.metrics import misclassification_error

from .measuring import clock, peak_memory
from .scenes import many_frames, many_tracks

SCENES = {"tracks": many_tracks, "frames": many_frames}


def measure(scene, n_tracks, n_frames, repeats, n_jobs):
    """Segment a scene of that size, the count known; for a process of its own.

    Parameters
    ----------
    scene : {"tracks", "frames"}
    n_tracks, n_frames, repeats : int
    n_jobs : int or None

    Returns
    -------
    dict
        ``seconds``, ``cpu_seconds`` and ``errors``, one a repeat, and ``peak``, bytes.
    """
    warm, _ = many_tracks(60, 3)
    MotionSegmenter(2, n_hypotheses=50, n_jobs=n_jobs, random_state=0).fit(warm)
    X, y = SCENES[scene](n_tracks, n_frames)
    seconds, cpu_seconds, errors = [], [], []
    for seed in range(repeats):
        segmenter = MotionSegmenter(int(y.max()) + 1, n_jobs=n_jobs, random_state=seed)
        taken, of_cpu, _ = clock(segmenter.fit, X)
        seconds.append(taken)
        cpu_seconds.append(of_cpu)
        errors.append(misclassification_error(y, segmenter.labels_))
    return {
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "errors": errors,
        "peak": peak_memory(),
    }


class _Scene:
    """The whole segmenter on a scene of a given size."""

    param_names = ["n_tracks", "n_frames"]

    def setup(self, n_tracks, n_frames):
        self.tracks, y = SCENES[self.scene](n_tracks, n_frames)
        self.segmenter = MotionSegmenter(int(y.max()) + 1, random_state=0)

    def time_fit(self, *_):
        self.segmenter.fit(self.tracks)

    def peakmem_fit(self, *_):
        self.segmenter.fit(self.tracks)


class ManyTracks(_Scene):
    scene = "tracks"
    params = [(500, 1000, 2000), (20,)]


class ManyFrames(_Scene):
    scene = "frames"
    params = [(500,), (125, 250, 500)]
