"""
Tracks that belong to no motion
===============================

A point tracker sometimes loses its point, and the track drifts away. If the number of
outliers is large, :class:`~skmotionseg.MotionSegmenter` may assign some of them to
motions. :func:`~skmotionseg.preprocessing.select_inliers` finds the tracks that do not
fit the epipolar geometry of their motion.
"""

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.plotting import plot_motions
from skmotionseg.preprocessing import select_inliers

X, y = make_rigid_motions(300, 12, 3, outliers=0.1, missing=0.1, random_state=0)
labels = MotionSegmenter(3, random_state=0).fit_predict(X)
kept = select_inliers(X, labels, whisker=3)

wandering = y == -1
print(f"outliers: {wandering.sum()}, rejected: {(wandering & ~kept).sum()}")
print(f"inliers: {(~wandering).sum()}, rejected: {(~wandering & ~kept).sum()}")

# %%
# Rejected tracks get the label -1 and are drawn as crosses. True outliers are circled:
# a circle without a cross is an outlier that was kept, a cross without a circle an
# inlier that was rejected.

first, last = 4, 7
figure, ax = plt.subplots(figsize=(7, 4.8), layout="constrained")
plot_motions(X, np.where(kept, labels, -1), frames=(first, last), ax=ax)
ends = unpack_tracks(X)[0][:, last]
ax.plot(*ends[wandering].T, "o", mfc="none", mec="black", ms=9, mew=0.8)
ax.plot(*ends[~kept].T, "x", color="black", ms=6)
ax.set_title("rejected tracks (crosses) and true outliers (circles)")
plt.show()
