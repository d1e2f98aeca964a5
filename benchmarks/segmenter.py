"""The whole way from tracks to labels."""

from __future__ import annotations

from skmotionseg import MotionSegmenter

from .scenes import clip_like

METHODS = {"default": {}, "coreg": {"fusion": "coreg", "selection": "ncre"}}


class Segmenter:
    """The default, and the paper's co-regularisation."""

    params = [
        tuple(METHODS),
        ("known", "unknown"),
        (200, 500, 1000),
        (10, 20),
        (100, 500),
    ]
    param_names = ["method", "count", "n_tracks", "n_frames", "n_hypotheses"]

    def setup(self, method, count, n_tracks, n_frames, n_hypotheses):
        self.tracks = clip_like(n_tracks, n_frames).data
        self.segmenter = MotionSegmenter(
            3 if count == "known" else "auto",
            n_hypotheses=n_hypotheses,
            random_state=0,
            **METHODS[method],
        )

    def time_fit(self, *_):
        self.segmenter.fit(self.tracks)

    def peakmem_fit(self, *_):
        self.segmenter.fit(self.tracks)


class Placing:
    """New tracks into the motions found."""

    params = [(200, 1000), (1000, 4000)]
    param_names = ["n_fitted", "n_new"]

    def setup(self, n_fitted, n_new):
        tracks = clip_like(n_fitted + n_new, 10).data
        self.new = tracks[n_fitted:]
        self.segmenter = MotionSegmenter(3, n_hypotheses=100, random_state=0)
        self.segmenter.fit(tracks[:n_fitted])

    def time_predict(self, *_):
        self.segmenter.predict(self.new)

    def peakmem_predict(self, *_):
        self.segmenter.predict(self.new)
