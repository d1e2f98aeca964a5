"""
A first segmentation
====================

Tracks go in, a motion for each comes out. The scene is synthetic: a camera that drives
and turns, before static surroundings and two things that move by themselves, one of
them flat. A quarter of the entries is unseen, and each coordinate is half a pixel off.
"""

import matplotlib.pyplot as plt

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error
from skmotionseg.plotting import plot_motions

X, y = make_rigid_motions(n_tracks=300, n_frames=12, random_state=0)
print(f"{len(X)} tracks, {X.shape[1] // 2} frames")

# %%
# Nothing need be said of how many motions there are. ``random_state`` makes the result
# the same each time: the method draws at random.

segmenter = MotionSegmenter(random_state=0).fit(X)
print(f"{segmenter.n_motions_} motions")
print(f"misclassified: {misclassification_error(y, segmenter.labels_):.1%}")

# %%
# Label 0 is the largest motion, here the static scene. Each line below is a track
# between two frames, the dot its end.

figure, axes = plt.subplots(2, 1, figsize=(7, 8), layout="constrained")
plot_motions(X, y, ax=axes[0], title="true motions")
plot_motions(X, segmenter.labels_, ax=axes[1], title="found motions")
plt.show()
