"""Simulated scenes with known motions and the noise of real trackers."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils import Bunch, check_random_state

from ._scene_families import FAMILIES, Thing
from ._scene_geometry import (
    NEAREST,
    background_motion,
    in_facets,
    in_patches,
    misfits,
    project,
)
from ._scene_tracks import (
    bending,
    lifetimes,
    photographs,
    tracker_noise,
    with_gaps,
    wrong_tracks,
)

MIN_GROUP = 10  # tracks of the smallest motion
PER_MOTION = 20  # tracks: no more motions are drawn than can have as many
N_PROBES = 40  # points that stand for a motion while it is drawn
N_DRAWS = 12  # of an object, until it is seen and differs from those before
PROBES_SEEN = 0.15  # share of the probes
APART = 2.0  # misfit of the 5 % of probes that tell motions apart least, in noises
N_JUDGED = 300  # tracks whose separation is computed

SCENE_FAMILIES = tuple(FAMILIES)

_RANGES = (
    *("n_tracks", "n_frames", "n_motions", "background", "outliers", "noise"),
    *("drift", "inertia", "spread", "shared", "late", "life", "seen", "gaps", "focal"),
    *("distortion", "texture", "motion_noise", "facets", "bending"),
)
_BOUNDS = dict.fromkeys(_RANGES, (0, 1)) | {
    "n_tracks": (1, np.inf),
    "n_frames": (2, np.inf),
    "n_motions": (1, np.inf),
    "outliers": (0, 0.9),
    "noise": (0, np.inf),
    "spread": (0, np.inf),
    "motion_noise": (0, np.inf),
    "bending": (0, np.inf),
    "life": (1, np.inf),
    "focal": (0.1, np.inf),
    "distortion": (-0.3, 0.3),
    "texture": (0.01, 1),
    "facets": (0, 10000),
}
_NOISES = ("noise", "drift", "inertia", "spread", "shared", "motion_noise")
# By random numbers of their own, so that all else is as it was without them.
_DRAWN_BY = {"texture": 1, "motion_noise": 1, "facets": 2, "bending": 3}
_MAY_BE_NONE = ("life", "seen")  # as long as the scene; in all frames that see it
_WHOLE_NUMBERS = ("n_tracks", "n_frames", "n_motions", "facets")
_LOGARITHMIC = ("n_tracks", "n_frames", "noise", "life", "texture", "facets")


def scene_families(n_frames: int | None = None) -> tuple[str, ...]:
    """Names of the families of simulated scenes.

    Parameters
    ----------
    n_frames : int, optional
        Only families that have scenes of this number of frames.

    Returns
    -------
    names : tuple of str

    Examples
    --------
    >>> from skmotionseg.datasets import scene_families
    >>> scene_families()[:3]
    ('street', 'still_camera', 'table')
    >>> scene_families(n_frames=2)
    ('two_images', 'one_motion')
    """
    if n_frames is None:
        return SCENE_FAMILIES
    return tuple(
        name
        for name, family in FAMILIES.items()
        if family.n_frames[0] <= n_frames <= family.n_frames[1]
    )


def make_scene(
    family: str,
    *,
    random_state: int | np.random.RandomState | None = None,
    **overrides: Any,
) -> Bunch:
    """A simulated scene of a family, with the noise of a real tracker.

    Parameters
    ----------
    family : str
        One of :func:`scene_families`.
    random_state : int, RandomState instance or None, default=None
    **overrides : number or (low, high)
        What is not to be drawn from the range of the family, or from another
        range: ``n_tracks`` (outliers included), ``n_frames``, ``n_motions`` (of
        a range, no more than can have 20 tracks each), ``background`` (share of
        the tracks that follow a motion), ``outliers`` (share of all tracks),
        ``noise`` (standard deviation of a coordinate one frame after the track
        begins, pixels), ``drift`` (share of its variance that adds up from
        frame to frame), ``inertia`` (correlation of what is added with what was
        added the frame before), ``spread`` (standard deviation over tracks of
        the logarithm of their noise), ``shared`` (share of the noise that
        neighbours have in common), ``motion_noise`` (what is added to the
        noise, in pixels per pixel that a track moves per frame), ``late``
        (share of the tracks that begin after the first frame), ``life`` (mean
        number of frames after which a track is lost; None: none is), ``seen``
        (share of the frames a point is found in, unordered photographs only),
        ``gaps`` (share of tracks with a gap), ``focal`` (image widths) and
        ``distortion`` (by which the lens moves the corners of the image, as a share of
        their distance from its middle; negative for barrels), ``texture`` (share of
        what stands still and is seen that has tracks, in patches; 1 in every
        other scene) and ``facets`` (number of flat pieces that what stands
        still consists of; 0: relief, as in a quarter of the scenes) and ``bending``
        (pixels per frame by which what moves by itself is not rigid, for the thing
        that bends most; 0 in two images and in photographs);
        ``image_size`` is (width, height) in pixels.

    Returns
    -------
    scene : Bunch
        Tracks, and what they were made of:

        - ``data``, ndarray of shape (n_tracks, 2 * n_frames): pixels, NaN where unseen;
        - ``target``, ndarray of int, shape (n_tracks,): 0, 1, ... with the largest
          motion first, -1 for tracks of no motion;
        - ``truth``, ndarray of shape (n_tracks, 2 * n_frames): the same tracks as
          images of rigid things, without noise, ``motion_noise`` and ``bending``;
        - ``n_motions``, int: fewer than asked for where no track of one is seen;
        - ``background``, int: label of what stands still in the world, -1 if nothing
          does;
        - ``separation``, float: share of the tracks of motions that their own motion
          explains best, of all true motions, each with the depth that fits best. Of 300
          tracks if there are more; 1 if there is one motion;
        - ``separations``, ndarray of shape (n_motions,): the same within each motion;
        - ``rotations``, ndarray of shape (n_motions, n_frames, 3, 3), and
          ``translations``, ndarray of shape (n_motions, n_frames, 3): from the
          coordinates of each object to those of the camera;
        - ``focal``, float: pixels; the principal point is the middle of the image;
        - ``image_size``, ndarray of shape (2,): width and height, pixels;
        - ``family``, str;
        - ``settings``, dict: what was drawn;
        - ``DESCR``, str.

    Raises
    ------
    ValueError
        If the family or an override is unknown or out of range.

    Examples
    --------
    >>> from skmotionseg.datasets import make_scene
    >>> scene = make_scene("street", n_tracks=200, n_frames=10, random_state=0)
    >>> scene.data.shape
    (200, 20)
    >>> scene.n_motions, int(scene.target.max())
    (3, 2)
    """
    if not isinstance(family, str) or family not in FAMILIES:
        raise ValueError(f"family must be one of {SCENE_FAMILIES}; got {family!r}")
    rng = check_random_state(random_state)
    # Of its own, lest all families have as many tracks and motions with one seed.
    streams = rng.randint(2**31 - 1, size=len(SCENE_FAMILIES))
    own = streams[SCENE_FAMILIES.index(family)]
    rngs = [np.random.RandomState(own ^ k) for k in range(4)]
    settings = _draw_settings(family, overrides, rngs)
    rng, late_rng, facet_rng, bend_rng = rngs
    chosen = FAMILIES[family]
    camera, surface, draw = chosen.build(settings, rng)
    if surface is not None and settings.facets:
        surface = in_facets(surface, settings.facets, camera, facet_rng)
    if surface is not None and settings.texture < 1:
        surface = in_patches(surface, settings.texture, camera, late_rng)
    things, shares = _draw_things(camera, surface, draw, settings, chosen, rng)
    filmed = camera, things, shares, surface is not None
    return _film(family, *filmed, settings, chosen, rng, bend_rng)


# --------------------------------------------------------------------------- assembling


def _draw_settings(family, overrides, rngs):
    rng, late_rng, facet_rng, _ = rngs
    chosen = FAMILIES[family]
    unknown = set(overrides) - {*_RANGES, "image_size"}
    if unknown:
        raise ValueError(
            f"overrides must be some of {(*_RANGES, 'image_size')}; got "
            f"{sorted(unknown)}"
        )
    settings = Bunch()
    sizes = chosen.sizes
    size = overrides.get("image_size", sizes[rng.randint(len(sizes))])
    settings.image_size = _as_image_size(size)
    for name in _RANGES:
        given = _given(name, chosen, overrides)
        settings[name] = _draw_setting(name, given, rngs[_DRAWN_BY.get(name, 0)])
    if "texture" not in overrides and late_rng.uniform() < 0.5:
        settings.texture = 1.0
    if "facets" not in overrides and facet_rng.uniform() < 0.25:
        settings.facets = 0
    if "outliers" not in overrides and rng.uniform() < 0.25:
        settings.outliers = 0.0
    n_inliers = settings.n_tracks - round(settings.outliers * settings.n_tracks)
    n_motions = _given("n_motions", chosen, overrides)
    if np.ndim(n_motions):
        most = max(n_inliers // PER_MOTION, n_motions[0])
        settings.n_motions = min(settings.n_motions, most)
    if n_inliers < settings.n_motions:
        raise ValueError(
            f"{n_inliers} tracks that are no outliers are too few for "
            f"{settings.n_motions} motions"
        )
    settings.focal *= settings.image_size[0]
    if settings.n_motions > 1 and settings.background is not None:
        # Leave a hundredth at least to each of the others.
        settings.background = min(
            settings.background, 1 - 0.01 * (settings.n_motions - 1)
        )
    return settings


def _given(name, chosen, overrides):
    """What a setting is drawn from: the override, or what the family has."""
    if name not in overrides:
        return getattr(chosen, name)
    if overrides[name] is None and name not in _MAY_BE_NONE:
        raise _not_a_range(name, None)
    return overrides[name]


def _draw_setting(name, given, rng):
    uniform = rng.uniform()
    if given is None:
        return None
    low, high = _as_range(name, given)
    if name in _WHOLE_NUMBERS:
        low, high = low - 0.49, high + 0.49
    if name in _LOGARITHMIC and low > 0:
        value = low * (high / low) ** uniform
    else:
        value = low + (high - low) * uniform
    return round(value) if name in _WHOLE_NUMBERS else float(value)


def _as_range(name, given):
    least, most = _BOUNDS[name]
    try:
        low, high = map(float, given if np.ndim(given) else (given, given))
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not low <= high < np.inf:
        raise _not_a_range(name, given)
    if name in _WHOLE_NUMBERS and (low % 1 or high % 1):
        raise ValueError(f"{name} must be whole; got {given!r}")
    if low < least or high > most:
        limits = f"{least:g} or more" if most == np.inf else f"in [{least:g}, {most:g}]"
        raise ValueError(f"{name} must be {limits}; got {given!r}")
    return low, high


def _not_a_range(name, given):
    return ValueError(f"{name} must be a number or (low, high); got {given!r}")


def _as_image_size(given):
    size = np.asarray(given, dtype=float)
    if size.shape != (2,) or not ((size > 0) & np.isfinite(size)).all():
        raise ValueError(
            f"image_size must be (width, height), in pixels above 0; got {given!r}"
        )
    return size


def _draw_things(camera, surface, draw, settings, chosen, rng):
    """The background, if there is one, and objects that move unlike all others."""
    things, probes = [], []  # probes: points, frames seen in
    if surface is not None:
        n_frames = settings.n_frames
        still = np.tile(np.eye(3), (n_frames, 1, 1)), np.zeros((n_frames, 3))
        things.append(Thing(background_motion(camera), surface, *still, np.inf))
        probes.append(_probe(things[0], camera, settings, chosen, rng))
    while len(things) < settings.n_motions:
        drawn: list[tuple[float, Thing, tuple]] = []  # merit, thing, probe
        while len(drawn) < 4 * N_DRAWS:
            thing = draw(things)
            probe = _probe(thing, camera, settings, chosen, rng)
            merit = _merit(thing, probe, things, probes, camera, settings)
            drawn.append((merit, thing, probe))
            highest = max(each[0] for each in drawn)
            if highest >= (1 if len(drawn) < N_DRAWS else 0.1):  # 0.1: seen, at least
                break
        _, thing, probe = max(drawn, key=lambda each: each[0])
        things.append(thing)
        probes.append(probe)
    shares = [max(len(probe[0]) / N_PROBES, 0.05) for probe in probes]
    return things, shares


def _probe(thing, camera, settings, chosen, rng):
    points, _, _, seen = _track(thing, N_PROBES, [], camera, settings, chosen, rng)
    kept = seen.any(axis=1)
    return points[kept], seen[kept]


def _merit(thing, probe, things, probes, camera, settings):
    """1 if a thing is seen and tells itself from the others, less if it does not."""
    points, seen = probe
    share = len(points) / N_PROBES
    if share < PROBES_SEEN:
        return 0.1 * share / PROBES_SEEN
    length = seen.sum(axis=1).mean()
    growth = settings.drift * length / 6 * (1 + settings.inertia)
    noise = settings.noise * np.sqrt(1 + growth)
    apart = np.inf
    if things:
        theirs = misfits(points, seen, [other.motion for other in things], camera, 2)
        apart = np.quantile(theirs.min(axis=0), 0.05)
        points = np.concatenate([other[0] for other in probes])
        seen = np.concatenate([other[1] for other in probes])
        if len(points):
            mine = misfits(points, seen, [thing.motion], camera, 2)[0]
            apart = min(apart, np.quantile(mine, 0.05))
    enough = APART * noise
    return 1.0 if apart >= enough else 0.1 + 0.9 * apart / enough


def _track(thing, n_tracks, occluders, camera, settings, chosen, rng):
    """Points of a thing: pixels, their depths, frames of birth, frames seen in."""
    n_frames = settings.n_frames
    births = np.zeros(n_tracks, dtype=int)
    if chosen.seen is not None:
        births = rng.randint(n_frames, size=n_tracks)
    elif not chosen.whole and n_frames > 3:
        latest = n_frames - _min_seen(settings)
        late = rng.uniform(size=n_tracks) < settings.late
        births = np.where(late, rng.randint(latest + 1, size=n_tracks), 0)
    if settings.life is None or chosen.whole:
        ends = np.full(n_tracks, n_frames)
    else:
        ends = births + 2 + rng.exponential(settings.life, size=n_tracks)
    surface = thing.surface(births, rng)
    points, depths = project(surface, thing.motion, camera)
    x, y = points[..., 0], points[..., 1]
    visible = (depths > NEAREST) & (x > 0) & (x < camera.size[0])
    visible &= (y > 0) & (y < camera.size[1])
    for middle, spread, depth in occluders:
        along, across = x - middle[:, 0], y - middle[:, 1]
        far = spread[:, 0, 0] * along**2 + spread[:, 1, 1] * across**2
        far += 2 * spread[:, 0, 1] * along * across
        visible &= (far > 3) | (depths < depth)
    if chosen.whole:
        seen = visible & visible.all(axis=1, keepdims=True)
    elif chosen.seen is not None:
        share = 1.0 if settings.seen is None else settings.seen
        seen = photographs(visible, share, 2, rng)
    else:
        seen = lifetimes(visible, births, ends, _min_seen(settings))
        if settings.gaps:
            seen = with_gaps(seen, settings.gaps, _min_seen(settings), rng)
    return points, depths, births, seen


def _min_seen(settings):
    return min(4, settings.n_frames)


def _occluder(thing, camera, rng):
    """An ellipse in each frame that hides what is behind it."""
    points, depths = project(
        thing.surface(np.zeros(24, dtype=int), rng), thing.motion, camera
    )
    middle = points.mean(axis=0)
    gaps = points - middle
    covariance = np.einsum("nfi,nfj->fij", gaps, gaps) / len(points)
    spread = np.linalg.inv(covariance + 1e-3 * np.eye(2))
    return middle, spread, np.where(depths.min(axis=0) > 0.2, depths.mean(axis=0), 1e9)


def _group_sizes(n_tracks, n_motions, has_background, settings, rng):
    """Tracks of each motion: none tiny, the background as large as was drawn."""
    weights = np.exp(rng.uniform(0, np.log(rng.uniform(1, 15)), size=n_motions))
    shares = weights / weights.sum()
    if has_background and n_motions > 1:
        rest = shares[1:] / shares[1:].sum()
        shares = np.array([settings.background, *(1 - settings.background) * rest])
    smallest = min(MIN_GROUP, n_tracks // n_motions)
    sizes = np.maximum(np.floor(shares * n_tracks).astype(int), smallest)
    sizes[sizes.argmax()] += max(n_tracks - sizes.sum(), 0)
    for _ in range(sizes.sum() - n_tracks):
        sizes[sizes.argmax()] -= 1
    return sizes


def _fill(thing, size, share, occluders, camera, settings, chosen, rng):
    """``size`` tracks of a thing that are seen, fewer only if hardly any is."""
    found, n_found = [], 0
    for _ in range(30):
        n_more = int((size - n_found) / share * 1.1) + 8
        n_more = min(n_more, 20 * size + 200)
        points, _, _, seen = _track(
            thing, n_more, occluders, camera, settings, chosen, rng
        )
        kept = np.flatnonzero(seen.any(axis=1))
        share = max(len(kept) / n_more, 0.02)
        kept = kept[: size - n_found]
        found.append((points[kept], seen[kept]))
        n_found += len(kept)
        if n_found == size:
            break
    points, seen = zip(*found, strict=True)
    return np.concatenate(points), np.concatenate(seen)


def _tracks(camera, things, shares, has_background, settings, chosen, rng):
    """Points of all things, frames seen in, and motions; -1 is of those of none."""
    n_motions = len(things)
    n_outliers = round(settings.outliers * settings.n_tracks)
    n_inliers = settings.n_tracks - n_outliers
    sizes = _group_sizes(n_inliers, n_motions, has_background, settings, rng)
    extra = rng.multinomial(n_outliers, sizes / sizes.sum())
    objects = range(int(has_background), n_motions)
    discs = {motion: _occluder(things[motion], camera, rng) for motion in objects}
    parts = []
    for motion, thing in enumerate(things):
        others = [disc for other, disc in discs.items() if other != motion]
        size = sizes[motion] + extra[motion]
        share, options = shares[motion], (camera, settings, chosen, rng)
        filled = _fill(thing, size, share, others, *options)
        if len(filled[0]) < size:  # hidden: then nothing hides it
            filled = _fill(thing, size, share, [], *options)
        parts.append(filled)
    found = np.array([len(part[0]) for part in parts])
    sizes = np.minimum(sizes, found)  # where few are seen, there are fewer outliers
    target = np.concatenate(
        [
            np.where(np.arange(n) < size, motion, -1)
            for motion, (n, size) in enumerate(zip(found, sizes, strict=True))
        ]
    )
    motion_of = np.repeat(np.arange(n_motions), found)
    points, seen = map(np.concatenate, zip(*parts, strict=True))
    points, seen = _spoil(points, seen, target, motion_of, camera, chosen, rng)
    return points, seen, target


def _background_among(order, family, settings):
    """The label of what stands still, which is the first of the things."""
    if 0 not in order:
        raise ValueError(
            f"the camera of this {family} scene sees no track of what stands still; "
            f"its focal length is {settings.focal:.3g} pixels, and tracks are seen in "
            f"{'all' if settings.seen is None else format(settings.seen, '.0%')} of "
            "the frames that could see them"
        )
    return int(np.flatnonzero(order == 0)[0])


def _film(
    family, camera, things, shares, has_background, settings, chosen, rng, bend_rng
):
    points, seen, target = _tracks(
        camera, things, shares, has_background, settings, chosen, rng
    )
    target, order = _largest_first(target, len(things))
    background = _background_among(order, family, settings) if has_background else -1
    shuffled = rng.permutation(len(points))
    points, seen, target = points[shuffled], seen[shuffled], target[shuffled]
    noise = {name: settings[name] for name in _NOISES}
    errors = tracker_noise(points, seen, **noise, rng=rng)
    levels = {
        label: settings.bending * bend_rng.uniform(0.2, 1)
        for label in range(len(things))
        if label != background
    }
    errors += bending(points, seen, target, levels, bend_rng)
    motions = [things[motion].motion for motion in order]
    separations, separation = _separation(
        points + errors, seen, target, motions, camera
    )
    points = _distorted(points, settings.distortion, camera.size)
    scene = Bunch(
        data=_packed(points + errors, seen),
        target=target,
        truth=_packed(points, seen),
        n_motions=len(motions),
        background=background,
        separation=separation,
        separations=separations,
        rotations=np.array([motion.rotations for motion in motions]),
        translations=np.array([motion.translations for motion in motions]),
        focal=camera.focal,
        image_size=camera.size,
        family=family,
        settings=dict(settings),
    )
    scene.DESCR = _describe(scene)
    return scene


def _distorted(points, share, size):
    """Points as a lens shows them that moves the corners of the image by a share."""
    middle = np.asarray(size) / 2
    from_middle = points - middle
    squares = (from_middle**2).sum(axis=-1, keepdims=True) / (middle**2).sum()
    return points + share * squares * from_middle


def _spoil(points, seen, target, motion_of, camera, chosen, rng):
    """Turn the tracks of label -1 into such as follow no motion."""
    wrong = np.flatnonzero(target < 0)
    if len(wrong) == 0:
        return points, seen
    # Beside what moves otherwise if there is such a thing, else what stands still.
    partners = rng.randint(len(points), size=len(wrong))
    others = points[partners]
    same = motion_of[partners] == motion_of[wrong]
    others = np.where(same[:, None, None], others[:, :1], others)
    points[wrong] = wrong_tracks(
        points[wrong], seen[wrong], others, chosen.kinds, camera.size, rng
    )
    inside = (points[wrong] > 0).all(axis=2) & (points[wrong] < camera.size).all(axis=2)
    left = seen[wrong] & inside
    enough = left.sum(axis=1) >= min(3, seen.shape[1])
    seen[wrong] = np.where(enough[:, None], left, seen[wrong])
    points[wrong] = np.clip(points[wrong], 0, camera.size)
    return points, seen


def _largest_first(target, n_motions):
    """Labels by size, and which motion each of them was."""
    sizes = np.bincount(target[target >= 0], minlength=n_motions)
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] > 0]
    labels = np.full(n_motions + 1, -1)
    labels[order] = np.arange(len(order))
    return labels[target], order


def _separation(points, seen, target, motions, camera):
    """Shares of tracks that their own motion explains best: each motion, and all."""
    sizes = np.bincount(target[target >= 0], minlength=len(motions))
    if len(motions) == 1:
        return np.ones(1), 1.0
    # All of the small motions, and some of the large.
    quota = max(N_JUDGED // len(motions), 1)
    kept = np.concatenate(
        [np.flatnonzero(target == motion)[:quota] for motion in range(len(motions))]
    )
    gaps = misfits(points[kept], seen[kept], motions, camera, 2)
    best = gaps.argmin(axis=0) == target[kept]
    shares = np.array(
        [best[target[kept] == motion].mean() for motion in range(len(motions))]
    )
    return shares, float(shares @ sizes / sizes.sum())


def _packed(points, seen):
    return np.where(seen[..., None], points, np.nan).reshape(len(points), -1)


def _describe(scene):
    n_tracks, n_frames = len(scene.data), scene.data.shape[1] // 2
    return (
        f"{scene.family}: {scene.n_motions} motions, {n_tracks} tracks over {n_frames} "
        f"frames, {np.isnan(scene.data).mean():.0%} unseen, "
        f"{np.mean(scene.target < 0):.0%} outliers"
    )
