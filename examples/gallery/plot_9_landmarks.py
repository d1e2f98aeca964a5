"""
Many tracks
===========

The affinity matrix is quadratic in the number of tracks, and so would be memory and
time. If there are many tracks, :class:`~skmotionseg.MotionSegmenter` fits some of them,
the landmarks, and labels the others as ``predict`` does. ``n_landmarks`` sets their
number. By default it depends on the number of tracks, and few tracks are all fitted.
"""

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

X, y = make_rigid_motions(3000, 10, 4, random_state=2)
segmenter = MotionSegmenter(random_state=0).fit(X)
print(f"{len(X)} tracks, {len(segmenter.landmarks_)} landmarks")
print(f"{segmenter.n_motions_} motions (true: {len(np.unique(y))})")
print(f"misclassified: {misclassification_error(y, segmenter.labels_):.1%}")

# %%
# Landmarks are drawn evenly from all parts of the scene, so that small motions are
# represented.

print("motion   tracks   landmarks")
for motion in range(4):
    n_landmarks = np.sum(y[segmenter.landmarks_] == motion)
    print(f"{motion:6d} {np.sum(y == motion):8d} {n_landmarks:11d}")

# %%
# How many are necessary? With too few landmarks, the smallest motion has too few of
# them, and is merged with another.

scenes = [make_rigid_motions(2000, 10, 4, random_state=seed) for seed in range(3)]
numbers = [50, 100, 200]
errors = np.empty((len(numbers), len(scenes)))
for i, n_landmarks in enumerate(numbers):
    for j, (X, y) in enumerate(scenes):
        segmenter = MotionSegmenter(
            max_motions=6, n_landmarks=n_landmarks, random_state=0
        ).fit(X)
        errors[i, j] = misclassification_error(y, segmenter.labels_)

figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(numbers, 100 * errors, "o", color="0.7")
ax.plot(numbers, 100 * errors.mean(axis=1), "-", color="black")
ax.set_xscale("log", base=2)
ax.set_xticks(numbers, numbers)
ax.set(xlabel="landmarks, of 2,000 tracks", ylabel="misclassified tracks (%)")
ax.set_title("three scenes of four motions, their number unknown, and the mean")
plt.show()
