"""
A first segmentation
====================

Tracks in, a motion label for each out. The scene is synthetic: a camera that moves and
turns, a static background and two objects that move independently, one of them planar.
A quarter of the entries is missing, and the noise is half a pixel.
"""

import matplotlib.pyplot as plt

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error
from skmotionseg.plotting import plot_motions

X, y = make_rigid_motions(n_tracks=300, n_frames=12, random_state=0)
print(f"{len(X)} tracks, {X.shape[1] // 2} frames")

# %%
# The number of motions is not given. ``random_state`` makes the result reproducible, as
# hypotheses are drawn at random.

segmenter = MotionSegmenter(random_state=0).fit(X)
print(f"{segmenter.n_motions_} motions")
print(f"misclassified: {misclassification_error(y, segmenter.labels_):.1%}")

# %%
# Label 0 is the largest motion, here the static scene. Each line below is a track
# between two frames, with a dot at its end.

figure, axes = plt.subplots(2, 1, figsize=(7, 8), layout="constrained")
plot_motions(X, y, ax=axes[0], title="true motions")
plot_motions(X, segmenter.labels_, ax=axes[1], title="found motions")
plt.show()
