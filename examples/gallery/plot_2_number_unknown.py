"""
How many motions? Reading the costs
===================================

With ``n_motions="auto"``, the number of motions is the largest of which a partition is
found whose motions are all likelier different than one. ``log_odds_`` holds, for each
number in ``counts_``, the log odds that the two most similar motions of its best
partition are two and not one, and ``count_probabilities_`` the probability of the
number. ``counts_`` may end before ``max_motions``, where more motions are not worth a
search.

``costs_`` tells what a larger number saves: the share of the links between tracks that
it cuts, the length of the description of its tracks, in nats, and their weighted sum.
``cost_names_`` says which costs these are. The first increases with the number of
motions, and the second decreases as long as more motions describe the tracks better.
"""

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions

X, y = make_rigid_motions(n_tracks=300, n_frames=12, n_motions=4, random_state=3)
segmenter = MotionSegmenter(max_motions=8, random_state=0).fit(X)
weights = segmenter.cost_weights_
names = [
    name if weight == 1 else f"{weight:g} x {name}"
    for weight, name in zip(weights, segmenter.cost_names_, strict=True)
]
print(f"motions   {names[0]:>27s}   {names[1]:>14s}   {'total':>5s}   log odds")
for count, costs, odds in zip(
    segmenter.counts_, segmenter.costs_, segmenter.log_odds_, strict=True
):
    first, second = costs[:2] * weights
    print(f"{count:7d} {first:29.2f} {second:16.2f} {costs[2]:7.2f} {odds:10.1f}")
print(f"chosen: {segmenter.n_motions_} (true: {len(set(y))})")

# %%
# If two numbers are nearly as probable, both partitions may be of interest:
# ``candidate_labels_[i]`` is the best partition into ``counts_[i]`` motions. The total
# does not choose the number: in other clips, it is still falling there.

first, second = segmenter.costs_[:, :2].T * np.reshape(weights, (2, 1))
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(segmenter.counts_, segmenter.costs_[:, 2], "o-", color="black", label="total")
ax.plot(segmenter.counts_, second, "s--", color="#0072b2", label=names[1])
ax.plot(segmenter.counts_, first, "^:", color="#d55e00", label=names[0])
ax.axvline(segmenter.n_motions_, color="0.8", lw=8, zorder=0, label="chosen")
ax.set(xlabel="number of motions", ylabel="cost")
ax.legend(frameon=False)
plt.show()
