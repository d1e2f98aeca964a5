"""Partitions by rigid motion over windows, and how many motions there are."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from ..geometry.windows import FOCAL_STEPS
from ..labels import groups_of
from .apartness import FEW_TRACKS
from .local_search import split
from .rigid_search import Step
from .side_by_side import side_by_side

# Where over-segments leave noise above this, in pixels of a video 640 pixels wide, they
# may mix motions, of which there are more. They do if twice as many leave less than
# this share of it: twelve that move apart leave 0.19, and scenes of two to eight, of
# which hardly any is that rough, 0.35 and more.
ROUGH, LESS_ROUGH = 0.3, 0.6
# Changes of a partition that are made at most; one or two are usual.
MOST_CHANGES = 5
# Rounds of assigning and fitting that a partition is settled in, at most.
ROUNDS = 6
# Nats per track that a partition costs beside its energy, for each unit by which the
# log odds of its motions being different are less.
NATS_OF_ODDS = 0.3
# Log odds above this, and below its negative, count as this.
SURE = 4.0
# Nats per track that are added where two of the motions are likelier one: more than
# partitions differ by otherwise, so that these come last.
LIKELIER_ONE = 1000.0
# Numbers of motions beyond the one chosen so far that are searched, too: the next one,
# unless by the log odds there are hardly as many (one in twenty), and that behind it
# where the best split is apart: two motions that are missing are mixed until both are
# there.
LOOKAHEAD, HOPELESS = 2, -3.0


class RigidPartitions(NamedTuple):
    """Partitions by rigid motion, and the number of motions.

    Attributes
    ----------
    steps : dict of int to Step
        The best partition for each number of motions that was met. The log odds of
        those that were searched as if their number had been given are by longer windows
        where there are some.
    chosen : int
        The number of motions.
    """

    steps: dict[int, Step]
    chosen: int


def rigid_partitions(search, over_segments, counts, candidates, bisect, finer=None):
    """Partitions of least energy, and how many motions there are.

    The number of motions is the largest of which a partition is found whose motions
    are all likelier different than one, by longer windows where there are some; its
    partition is the best of so many that are met, as if the number had been given. So
    are those of the numbers next to it.

    Parameters
    ----------
    search : RigidSearch
    over_segments : ndarray of int, shape (n,)
        Groups to merge.
    counts : ndarray of int, shape (n_counts,)
        Numbers of motions that may be.
    candidates : callable
        ``n_motions -> iterable of labels (n,)``: more partitions to start from.
    bisect : callable
        Takes the positions of a group to booleans, or to None if it cannot be parted.
    finer : callable, optional
        ``n_groups -> labels (n,) or None``: over-segments, perhaps fewer groups.

    Returns
    -------
    RigidPartitions or None
        None where no partition has as many motions as there must be.
    """
    fewest, most = int(counts[0]), int(counts[-1])
    bisect = _once_per_group(bisect)
    search.calibrate(over_segments)
    if finer is not None:
        over_segments = _fine_enough(search, over_segments, most, finer)
    path = calibrated_path(search, over_segments)
    steps = {step.n_motions: step for step in path if fewest <= step.n_motions <= most}

    def best_into(n_motions, *others):
        starts = _of_number(search, n_motions, path, candidates, bisect)
        (best,) = search.run(_best_improved(search, starts, bisect, others))
        is_open = best is not None and fewest < most
        return _judged_by_longer_windows(search, best) if is_open else best

    chosen = _n_apart(path, fewest, most)
    while True:
        found = best_into(chosen)
        if found is None:
            return None
        steps[chosen] = found
        if chosen == fewest or found.log_odds > 0:
            break
        chosen -= 1
    tried, few = chosen, len(over_segments) <= FEW_TRACKS
    while tried < min(chosen + LOOKAHEAD, most):
        (grown,) = search.run(_split_best(search, steps[tried], bisect))
        least = HOPELESS if tried == chosen else 0.0
        if grown is None or (grown.log_odds < least and not few):
            break
        tried += 1
        steps[tried] = found = best_into(tried, grown)
        if found.log_odds > 0:
            chosen = tried
        elif found.log_odds < HOPELESS and not few:
            break
    return RigidPartitions(steps, chosen)


def _fine_enough(search, over_segments, most, finer):
    """Over-segments that mix no motions, and the search calibrated by them."""
    while search.noise > ROUGH:
        noise, n_groups = search.noise, int(over_segments.max()) + 1
        more = finer(2 * n_groups) if n_groups < most else None
        if more is None or more.max() < n_groups:
            break
        search.restart(more)
        if search.noise > LESS_ROUGH * noise:
            search.restart(over_segments)
            break
        over_segments = more
    return over_segments


def calibrated_path(search, over_segments):
    """The descent from over-segments to one group, seen by a calibrated camera.

    Over-segments are small and nearly flat, so they tell little of the focal length;
    with a wrong one, a scene is not quite one rigid motion, and is torn where it is
    large. So it is looked at again when they are merged, and if it has changed, they
    are merged once more.

    Parameters
    ----------
    search : RigidSearch
        Calibrated by them.
    over_segments : ndarray of int, shape (n,)

    Returns
    -------
    list of Step
    """
    (path,) = search.run(search.descent(over_segments, 1))
    last = _last_apart(path)
    if search.calibrate(last.labels, FOCAL_STEPS[:2], last.motions):
        (path,) = search.run(search.descent(over_segments, 1))
    return path


def _last_apart(path):
    """The step of a path with the most groups that are all apart; else its last.

    By their distance, which rather leaves a motion in parts than mixes two.
    """
    return next((step for step in path if step.distance > 0), path[-1])


def rank(step, decided=True):
    """What a partition costs when partitions into as many are compared: nats per track.

    One motion is not likely to explain two that are true, as it explains halves of a
    background, whatever these save. Where one does likelier than not, there are hardly
    as many motions in the partition, so all others come before it; unless that is not
    decided by these log odds, but by those of longer windows.
    """
    odds = min(max(step.log_odds, -SURE), SURE)
    cost = step.energy / len(step.labels) - NATS_OF_ODDS * odds
    return cost + LIKELIER_ONE if decided and step.log_odds <= 0 else cost


def rank_in(search):
    """How partitions of a search are compared: its :func:`rank`."""
    return partial(rank, decided=search.decides)


def _n_apart(path, fewest, most):
    """The largest number of groups on a path that are all apart."""
    apart = (step.n_motions for step in path if step.log_odds > 0)
    return max((n for n in apart if fewest <= n <= most), default=fewest)


def _once_per_group(bisect):
    """The same function, remembering what it returned."""
    known = {}

    def remembered(group):
        key = group.tobytes()
        if key not in known:
            known[key] = bisect(group)
        return known[key]

    return remembered


def _of_number(search, n_motions, path, candidates, bisect):
    """Searches for partitions into so many motions, from several starts."""
    settled = [
        search.settled(step.labels, step.motions, ROUNDS)
        for step in path
        if step.n_motions == n_motions
    ]
    settled += [search.settled(some, rounds=ROUNDS) for some in candidates(n_motions)]
    searches = [_step_of(search, each, lambda n: n == n_motions) for each in settled]
    return [*searches, _apart_and_split(search, path, n_motions, bisect)]


def _best_improved(search, searches, bisect, others=()):
    """The best of some steps and those that are found, improved."""
    best = yield from _best(search, searches, others)
    return None if best is None else (yield from _improved(search, best, bisect))


def _best(search, searches, others=()):
    """The best of some steps and those that are found; None if there are none."""
    found = yield from side_by_side(searches)
    steps = [*others, *(each for each in found if each is not None)]
    return min(steps, key=rank_in(search), default=None)


def _step_of(search, settled, accepted):
    """The step of a partition that is settled, if its number of motions is accepted."""
    step = yield from settled
    return (yield from with_odds(search, step)) if accepted(step.n_motions) else None


def _apart_and_split(search, path, n_motions, bisect):
    """The last groups of a path that are all apart, split to as many as are wanted."""
    apart = [step for step in path if step.log_odds > 0 and step.n_motions < n_motions]
    step = apart[0] if apart else None
    while step is not None and step.n_motions < n_motions:
        step = yield from _split_best(search, step, bisect)
    return step


def _improved(search, best, bisect):
    """A better partition: a group is split, and two others merged."""
    cost = rank_in(search)
    for _ in range(MOST_CHANGES):
        changed = _splits(search, best, bisect)
        merged = (_merged(search, some, best) for some in changed)
        better = yield from _best(search, merged)
        if better is None or not cost(better) < cost(best):
            break
        best = better
    return best


def _merged(search, labels, best):
    """The step at the end of a descent to as many motions, if it may be better."""
    step = (yield from search.descent(labels, best.n_motions))[-1]
    cost = rank_in(search)
    if step.n_motions == best.n_motions and cost(step) < cost(best):
        return (yield from with_odds(search, step))
    return None


def _split_best(search, step, bisect):
    """The best partition with one group more; None if none can be parted."""
    parted = (
        _step_of(search, search.settled(some), lambda n: n > step.n_motions)
        for some in _splits(search, step, bisect)
    )
    return _best(search, parted)


def _splits(search, step, bisect):
    """Partitions with one group more: halves of the graph, and what is unexplained."""
    yield from split(step.labels, bisect)
    yield from search.unexplained(step.labels, step.motions)


def _judged_by_longer_windows(search, step):
    """A step with the two groups that are least apart, and log odds, by longer windows.

    With its own motions, and as it is where there are no such windows.
    """
    judge = search.over_longer_windows() if step.n_motions > 1 else None
    if judge is None:
        return step
    (judged,) = judge.run(_judged(judge, step))
    return judged


def _judged(judge, step):
    """Search for what other windows say of a step; itself where they do not tell.

    The focal length is chosen once more: where it is wrong, what turns is torn, the
    more the longer it is watched.
    """
    motions = yield from judge.motions(step.labels)
    if not _all_known(step.labels, motions):
        return step
    if judge.calibrate(step.labels, FOCAL_STEPS[:2], motions):
        motions = yield from judge.motions(step.labels)
    (i, j), least = yield from judge.comparisons.least_apart(step.labels, motions)
    return step.compared(i, j, least)


def _all_known(labels, motions):
    """Whether motions say something of most tracks of each group."""
    return all(
        2 * np.count_nonzero(motion.known[group]) > len(group)
        for group, motion in zip(groups_of(labels), motions, strict=True)
    )


def with_odds(search, step):
    """Search for the two groups of a step that are least apart: the step with them."""
    if step.n_motions == 1:
        return step
    (i, j), least = yield from search.comparisons.least_apart(step.labels, step.motions)
    return step.compared(i, j, least)
