"""The stages by themselves: hypotheses, kernel, fusion, count."""

from __future__ import annotations

from skmotionseg import (
    HypothesisSampler,
    MultiModelSpectralClustering,
    NCREModelSelector,
    ORKKernel,
    make_motion_pipeline,
)

from .scenes import clip_like

MODELS = ("affine", "homography", "fundamental")
FUSIONS = ("kernel_addition", "coreg", "subset")


class View:
    """One model: from tracks to residuals to affinities, and new tracks likewise."""

    params = [MODELS, (200, 1000), (10, 40), (100, 500)]
    param_names = ["model", "n_tracks", "n_frames", "n_hypotheses"]

    def setup(self, model, n_tracks, n_frames, n_hypotheses):
        self.tracks = clip_like(n_tracks, n_frames).data
        self.sampler = HypothesisSampler(
            model, n_hypotheses=n_hypotheses, random_state=0
        )
        self.kernel = ORKKernel(n_hypotheses=n_hypotheses)
        self.residuals = self.sampler.fit_transform(self.tracks)
        self.kernel.fit(self.residuals)

    def time_hypotheses(self, *_):
        self.sampler.fit_transform(self.tracks)

    def time_kernel(self, *_):
        self.kernel.fit_transform(self.residuals)

    def time_new_tracks(self, *_):
        self.kernel.transform(self.sampler.transform(self.tracks))

    def peakmem_view(self, *_):
        self.kernel.fit_transform(self.sampler.fit_transform(self.tracks))


class _FromAffinities:
    """What starts from the affinities of three models."""

    params = [FUSIONS, (200, 1000)]
    param_names = ["fusion", "n_tracks"]

    def setup(self, fusion, n_tracks):
        pipeline = make_motion_pipeline(n_hypotheses=100, random_state=0)
        self.views = pipeline[0].fit_transform(clip_like(n_tracks, 10).data)
        self.clusterer = MultiModelSpectralClustering(3, fusion=fusion, random_state=0)


class Fusion(_FromAffinities):
    """Labels, the count known."""

    def time_fusion(self, *_):
        self.clusterer.fit(self.views)


class Selection(_FromAffinities):
    """Labels and the count, of 1 to 10."""

    def time_counts(self, *_):
        NCREModelSelector(self.clusterer, random_state=0).fit(self.views)
