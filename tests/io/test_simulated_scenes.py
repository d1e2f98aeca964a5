"""Simulated scenes: what is in them is what was asked for, and their truth is one."""

from __future__ import annotations

import json
from itertools import islice

import numpy as np
import pytest
from helpers.textbook import fit_homography
from numpy.testing import assert_allclose, assert_array_equal

from benchmarks import scene_statistics, scenes_bench
from skmotionseg import unpack_tracks
from skmotionseg.datasets import make_scene, scene_families
from skmotionseg.datasets._scene_geometry import (
    Camera,
    Motion,
    blob,
    box,
    misfits,
    turned_to,
)
from skmotionseg.datasets._scene_tracks import lifetimes, tracker_noise, with_gaps

SMALL = {"n_tracks": (60, 150)}
every_family = pytest.mark.parametrize("family", scene_families())


def scene_of(family, seed=0, **overrides):
    return make_scene(family, random_state=seed, **(SMALL | overrides))


def places(X):
    return X.reshape(len(X), -1, 2)


# ------------------------------------------------------------------------ what is there


@every_family
@pytest.mark.parametrize("seed", range(4))
def test_a_scene_is_as_described(family, seed):
    scene = scene_of(family, seed)
    n_tracks, n_frames = scene.settings["n_tracks"], scene.settings["n_frames"]
    assert scene.data.shape == scene.truth.shape == (n_tracks, 2 * n_frames)
    assert_array_equal(np.isnan(scene.data), np.isnan(scene.truth))
    assert_array_equal(np.isnan(scene.data[:, ::2]), np.isnan(scene.data[:, 1::2]))
    assert np.isfinite(scene.data).sum(axis=1).min() >= 4  # two frames
    sizes = np.bincount(scene.target[scene.target >= 0])
    assert len(sizes) == scene.n_motions == scene.settings["n_motions"]
    assert (np.diff(sizes) <= 0).all()
    assert sizes.min() >= min(10, sizes.sum() // len(sizes))
    assert scene.rotations.shape == (scene.n_motions, n_frames, 3, 3)
    assert scene.translations.shape == (scene.n_motions, n_frames, 3)
    assert -1 <= scene.background < scene.n_motions
    assert 0 <= scene.separation <= 1
    assert scene.separations.shape == (scene.n_motions,)
    assert f"{scene.n_motions} motions, {n_tracks} tracks" in scene.DESCR


@every_family
def test_a_seed_gives_its_scene(family):
    first, again, other = (scene_of(family, seed) for seed in (5, 5, 6))
    assert_array_equal(first.data, again.data)
    assert_array_equal(first.target, again.target)
    assert first.separation == again.separation
    assert first.data.shape != other.data.shape or not np.array_equal(
        first.data, other.data, equal_nan=True
    )


@every_family
def test_numbers_and_ranges_override_what_is_drawn(family):
    n_frames = {"two_images": 2}.get(family, 7)
    scene = scene_of(family, n_frames=n_frames, outliers=0.3, n_motions=2, n_tracks=90)
    assert scene.data.shape == (90, 2 * n_frames)
    assert np.mean(scene.target < 0) == pytest.approx(0.3)
    assert scene.n_motions == 2
    seeds = range(5)
    drawn = [scene_of(family, seed, noise=(0.5, 0.6)).settings for seed in seeds]
    assert all(0.5 <= settings["noise"] <= 0.6 for settings in drawn)


def test_families_differ_though_the_seed_is_one():
    drawn = {scene_of(family).settings["n_tracks"] for family in scene_families()}
    assert len(drawn) > 5


def test_motions_have_tracks_enough_unless_their_number_is_asked_for():
    counts = [scene_of("street", s, n_tracks=60, outliers=0.2) for s in range(8)]
    assert max(scene.n_motions for scene in counts) == 2
    assert scene_of("street", n_tracks=60, outliers=0.2, n_motions=5).n_motions == 5


def test_families_by_number_of_frames():
    assert set(scene_families(n_frames=2)) == {"two_images", "one_motion"}
    assert scene_families(n_frames=150) == ("long",)


def test_scenes_may_have_no_noise():
    scene = make_scene("street", random_state=0, noise=0, n_tracks=60)
    assert scene.n_motions > 1 and np.isfinite(scene.separation)


@pytest.mark.parametrize(
    "family, overrides, words",
    [
        ("streets", {}, "family must be one of .*street.*; got 'streets'"),
        ("street", {"tracks": 3}, "overrides must be some of .*; got .*tracks"),
        ("street", {"noise": -1}, "noise must be 0 or more; got -1"),
        (
            "street",
            {"noise": (2, 1)},
            r"noise must be a number or \(low, high\); got \(2, 1\)",
        ),
        ("street", {"outliers": 1.0}, r"outliers must be in \[0, 0.9\]; got 1.0"),
        (["street"], {}, r"family must be one of .*; got \['street'\]"),
        ("street", {"n_motions": 0}, "n_motions must be 1 or more; got 0"),
        ("street", {"n_frames": 1}, "n_frames must be 2 or more; got 1"),
        ("street", {"drift": 1.5}, r"drift must be in \[0, 1\]; got 1.5"),
        ("street", {"n_tracks": 5, "n_motions": 6}, "tracks .* too few for 6 motions"),
        ("street", {"focal": "wide"}, "focal must be a number .*; got 'wide'"),
        ("street", {"image_size": (640,)}, "image_size must be .*; got"),
        ("street", {"image_size": (np.inf, 3)}, "image_size must be .*; got .inf"),
        ("street", {"background": None}, "background must be a number .*; got None"),
        ("street", {"n_frames": 2.5}, "n_frames must be whole; got 2.5"),
        ("photographs", {"seen": 0}, "sees no track of what stands still; .* in 0% of"),
        (
            "two_images",
            {"focal": 50, "n_tracks": 100, "n_motions": 4},
            "sees no track of what stands still; its focal length is 3.6",
        ),
    ],
)
def test_what_cannot_be_is_an_error(family, overrides, words):
    with pytest.raises(ValueError, match=words):
        make_scene(family, random_state=0, **overrides)


def test_photographs_may_all_show_what_they_see():
    some, all_ = (
        make_scene("photographs", seen=s, random_state=0) for s in (0.5, None)
    )
    assert np.isnan(all_.data).mean() < np.isnan(some.data).mean()


# --------------------------------------------------------------------------- the truth


@every_family
def test_the_truth_is_the_image_of_rigid_things(family):
    """Each motion explains its own tracks without any residual, noise apart."""
    scene = scene_of(family, seed=3, distortion=0)
    camera = Camera(None, None, scene.focal, scene.image_size)
    for motion in range(scene.n_motions):
        tracks = places(scene.truth[scene.target == motion])
        rigid = Motion(scene.rotations[motion], scene.translations[motion])
        seen = np.isfinite(tracks[..., 0])
        assert misfits(tracks, seen, [rigid], camera, 8).max() < 0.01


def test_a_lens_moves_corners_most_and_the_middle_not_at_all():
    straight, bent = (
        make_scene("street", random_state=3, distortion=share) for share in (0, -0.05)
    )
    middle = straight.image_size / 2
    before = places(straight.truth) - middle
    shift = places(bent.truth) - middle - before
    outward = np.linalg.norm(before, axis=-1) / np.linalg.norm(middle)
    share = (shift * before).sum(axis=-1) / (before**2).sum(axis=-1)
    seen = np.isfinite(share) & (outward > 0.01)
    assert_allclose(share[seen], -0.05 * outward[seen] ** 2, atol=1e-9)


def test_texture_is_in_patches_where_less_than_all_has_any():
    whole, patchy = (
        make_scene("hand_held", n_tracks=400, late=0, random_state=0, texture=share)
        for share in (1, 0.1)
    )
    assert_array_equal(whole.settings["n_motions"], patchy.settings["n_motions"])

    def crowding(scene):
        """Distance to the nearest other static track, over that between all."""
        still = places(scene.data)[scene.target == scene.background, 0]
        gaps = np.linalg.norm(still[:, None] - still, axis=2)
        np.fill_diagonal(gaps, np.inf)
        return np.nanmedian(np.nanmin(gaps, axis=1)) / np.nanmedian(gaps)

    assert crowding(patchy) < 0.7 * crowding(whole)


def test_every_other_scene_has_texture_everywhere():
    shares = [scene_of("two_images", k).settings["texture"] for k in range(24)]
    assert 4 <= sum(share == 1 for share in shares) <= 20
    assert 0.08 <= min(shares) <= 0.5


def test_what_stands_still_consists_of_flat_pieces():
    """One flat piece moves by a homography, relief does not."""
    flat, relief = (
        make_scene("hand_held", late=0, distortion=0, random_state=2, facets=facets)
        for facets in (1, 0)
    )
    misfit = []
    for scene in flat, relief:
        still = places(scene.truth)[scene.target == scene.background]
        first, last = still[:, 0], still[:, 4]
        both = np.isfinite(first[:, 0] + last[:, 0])
        found = fit_homography(first[both] / 500, last[both] / 500)
        misfit.append(np.abs(moved_by(found, first[both]) - last[both]).max())
    assert misfit[0] < 0.01 < 1 < misfit[1]


def moved_by(H, points):
    moved = np.column_stack([points / 500, np.ones(len(points))]) @ H.T
    return 500 * moved[:, :2] / moved[:, 2:]


def points_of(surface, n=4000):
    return surface(np.zeros(n, dtype=int), np.random.RandomState(0))


def test_a_box_shows_the_faces_that_look_this_way_as_large_as_they_seem():
    sides, eye = np.array([1.0, 2.0, 4.0]), np.array([0.6, 0.0, -0.8])
    on_face = np.isclose(points_of(box(sides, eye)), sides / 2 * np.sign(eye))
    seen = np.array([2 * 4 * 0.6, 0, 1 * 2 * 0.8])  # area times cosine
    assert_array_equal(on_face.sum(axis=1), 1)
    assert_allclose(on_face.mean(axis=0), seen / seen.sum(), atol=0.02)


def test_of_a_blob_only_the_front_is_there():
    radii, eye = np.array([1.0, 0.5, 0.7]), np.array([0.0, 0.6, 0.8])
    points = points_of(blob(radii, eye))
    assert (points @ eye >= 0).all()
    assert (np.linalg.norm(points / radii, axis=1) <= 1 + 1e-12).all()


def test_a_thing_is_turned_to_what_looks_at_it():
    eye, towards = np.array([0.6, 0.0, -0.8]), np.array([0.0, 1.0, 0.0])
    surface = box([1.0, 2.0, 4.0], eye)
    before, after = points_of(surface), points_of(turned_to(surface, eye, towards))
    assert_allclose(after @ towards, before @ eye)
    assert_allclose(after @ after[:50].T, before @ before[:50].T, atol=1e-12)
    assert_array_equal(points_of(turned_to(surface, eye, eye)), before)


def points_seen(scene, label):
    """Points (n, 3) of a motion, in its own coordinates, by their noiseless images."""
    rays = places(scene.truth[scene.target == label]) - scene.image_size / 2
    rays = np.dstack([rays / scene.focal, np.ones(rays.shape[:2])])
    points = []
    for track in rays:
        seen = np.isfinite(track[:, 0])
        across = np.cross(track[seen, :, None], np.eye(3)[None], axis=1)
        A = across.swapaxes(1, 2) @ scene.rotations[label][seen]
        b = -across.swapaxes(1, 2) @ scene.translations[label][seen, :, None]
        points.append(np.linalg.lstsq(A.reshape(-1, 3), b.ravel(), rcond=None)[0])
    return np.array(points)


@pytest.mark.parametrize("family", ["table", "hand_held", "crowd", "street"])
def test_things_show_the_side_that_faces_the_camera(family):
    scene = scene_of(family, n_motions=3, outliers=0.0, distortion=0.0, n_frames=12)
    for label in set(range(3)) - {scene.background}:
        rotation, centre = scene.rotations[label][6], scene.translations[label][6]
        eye = -rotation.T @ centre / np.linalg.norm(centre)
        assert (points_seen(scene, label) @ eye > 0).mean() > 0.7


def test_most_scenes_have_flat_pieces():
    pieces = [scene_of("hand_held", k).settings["facets"] for k in range(24)]
    assert 1 <= sum(number == 0 for number in pieces) <= 12
    assert set(pieces) - {0} <= set(range(4, 41))


def test_what_moves_by_itself_bends():
    """Its errors grow, and those of its sides differ; what stands still is rigid."""
    bent, rigid = (
        make_scene(
            "street", noise=1e-6, motion_noise=0, bending=bending, random_state=3
        )
        for bending in (1, 0)
    )
    np.testing.assert_array_equal(bent.truth, rigid.truth)
    assert_allclose(rigid.data, rigid.truth, atol=1e-4)
    still = bent.target == bent.background
    errors = places(bent.data - bent.truth)
    assert np.nanmax(np.abs(errors[still])) < 1e-4
    for label in set(range(bent.n_motions)) - {bent.background}:
        thing = errors[bent.target == label]
        first = np.isfinite(thing[..., 0]).argmax(axis=1)
        assert_allclose(thing[np.arange(len(thing)), first], 0, atol=1e-4)
        steps = np.diff(thing, axis=1)
        steps = steps[:, np.isfinite(steps[..., 0]).any(axis=0)]
        assert 0.02 < np.nanstd(steps) < 1.5
        assert np.nanstd(np.nanmean(steps, axis=0)) < 0.98 * np.nanstd(steps)


@every_family
def test_most_scenes_have_a_truth(family):
    separations = [scene_of(family, seed).separation for seed in range(10)]
    assert np.median(separations) >= 0.98


def test_motions_that_coincide_are_not_told_apart():
    """Where all stands still before a still camera, labels are a matter of chance."""
    rng = np.random.RandomState(0)
    still = Motion(np.tile(np.eye(3), (6, 1, 1)), np.zeros((6, 3)))
    camera = Camera(None, None, 500.0, np.array([640.0, 480.0]))
    points = rng.uniform(0, 480, size=(50, 1, 2)) + rng.standard_normal((50, 6, 2))
    alike = misfits(points, np.ones((50, 6), bool), [still, still], camera)
    assert_allclose(alike[0], alike[1])


def test_misfit_is_the_distance_to_the_nearest_image():
    """Against a search for the point by nonlinear least squares."""
    from scipy.optimize import least_squares

    scene = scene_of("hand_held", n_frames=8, n_motions=2, noise=0.5)
    camera = Camera(None, None, scene.focal, scene.image_size)
    motion = Motion(scene.rotations[0], scene.translations[0])
    tracks = places(scene.data[scene.target == 0])[:5]
    tracks = tracks[np.isfinite(tracks).all(axis=(1, 2))]
    seen = np.ones(tracks.shape[:2], bool)
    for track, misfit in zip(
        tracks, misfits(tracks, seen, [motion], camera, 10)[0], strict=True
    ):
        ray = (track[4] - scene.image_size / 2) / scene.focal

        def gaps(p, ray=ray, track=track):
            # The inverse depth p[2] may be below zero: points beyond infinity count.
            turned = motion.rotations @ motion.rotations[4].T
            moved = motion.translations - turned @ motion.translations[4]
            seen = turned @ [ray[0] + p[0], ray[1] + p[1], 1] + p[2] * moved
            image = scene.focal * seen[:, :2] / seen[:, 2:] + scene.image_size / 2
            return (image - track).ravel()

        best = min(least_squares(gaps, [0, 0, s]).cost for s in (0.1, 0.5, 1, 2))
        assert misfit == pytest.approx(np.sqrt(2 * best / 8), rel=0.02)


# -------------------------------------------------------------------------- the tracker


def test_noise_grows_as_it_drifts():
    rng = np.random.RandomState(0)
    points = rng.uniform(0, 500, size=(4000, 8, 2))
    seen = np.ones((4000, 8), bool)
    white = tracker_noise(points, seen, 0.5, 0, 0, 0, 0, 0, rng)
    assert_allclose(white.std(axis=(0, 2)), 0.5, rtol=0.05)
    walk = tracker_noise(points, seen, 0.5, 1, 0, 0, 0, 0, rng)
    assert_allclose(walk.std(axis=(0, 2)), 0.5 * np.sqrt(np.arange(8)), rtol=0.05)
    creep = tracker_noise(points, seen, 0.5, 1, 1, 0, 0, 0, rng)
    assert_allclose(creep.std(axis=(0, 2)), 0.5 * np.arange(8), rtol=0.05)


def test_noise_begins_with_the_track_and_has_its_scale():
    rng = np.random.RandomState(0)
    seen = np.arange(9) >= rng.randint(5, size=3000)[:, None]
    points = rng.uniform(0, 500, size=(3000, 9, 2))
    walk = tracker_noise(points, seen, 1, 1, 0.5, 0.7, 0, 0, rng)
    first = seen.argmax(axis=1)
    assert (walk[np.arange(3000), first] == 0).all()
    steps = np.abs(walk[np.arange(3000), first + 1]).mean(axis=1)
    assert np.log(steps).std() == pytest.approx(np.hypot(0.7, 0.55), rel=0.1)


def test_what_moves_fast_is_tracked_less_well():
    rng = np.random.RandomState(0)
    speeds = np.repeat([0.0, 3.0, 30.0], 1000)
    points = speeds[:, None, None] * np.arange(6)[:, None] * [0.6, 0.8]
    seen = rng.uniform(size=(3000, 6)) > 0.2
    errors = tracker_noise(points, seen, 0.2, 0, 0, 0, 0, 0.01, rng)
    found = errors.reshape(3, 1000, -1).std(axis=(1, 2))
    assert_allclose(found, np.hypot(0.2, [0, 0.03, 0.3]), rtol=0.06)


def test_neighbours_share_noise():
    rng = np.random.RandomState(0)
    points = np.repeat(rng.uniform(0, 500, size=(300, 5, 2)), 2, axis=0)
    seen = np.ones((600, 5), bool)
    for shared in (0, 0.5, 1):
        errors = tracker_noise(points, seen, 1, 0.5, 0, 0, shared, 0, rng)
        pairs = errors.reshape(300, 2, -1)
        alike = (pairs[:, 0] * pairs[:, 1]).sum() / (pairs**2).sum() * 2
        assert alike == pytest.approx(shared, abs=0.08)


def test_lifetimes_are_runs_that_end_when_hidden():
    visible = np.array([[1, 1, 1, 0, 1, 1], [1, 1, 1, 1, 1, 1], [0, 1, 1, 1, 1, 1]])
    seen = lifetimes(visible > 0, np.array([0, 2, 0]), np.array([6, 5.5, 6]), 2)
    expected = [[1, 1, 1, 0, 0, 0], [0, 0, 1, 1, 1, 1], [0] * 6]
    assert_array_equal(seen, np.array(expected) > 0)


def test_gaps_leave_enough():
    rng = np.random.RandomState(0)
    seen = np.arange(8) < rng.randint(3, 9, size=500)[:, None]
    left = with_gaps(seen, 1.0, 3, rng)
    assert (left <= seen).all()
    assert left.sum(axis=1).min() >= 3
    assert 0.3 < (left.sum(axis=1) < seen.sum(axis=1)).mean() < 1


@pytest.mark.parametrize("family", ["street", "planar", "crowd"])
def test_tracks_of_no_motion_follow_none(family):
    followed = []
    for seed in range(5):
        scene = scene_of(family, seed, n_tracks=200, n_frames=15, outliers=0.5)
        camera = Camera(None, None, scene.focal, scene.image_size)
        motions = [
            Motion(*path)
            for path in zip(scene.rotations, scene.translations, strict=True)
        ]
        tracks = places(scene.data)
        gaps = misfits(tracks, np.isfinite(tracks[..., 0]), motions, camera).min(axis=0)
        limit = np.quantile(gaps[scene.target >= 0], 0.9)
        followed.append(np.mean(gaps[scene.target < 0] < limit))
    assert np.mean(followed) < 0.2


# ------------------------------------------------------------------------ the benchmark


class Oracle:
    """Knows the answer of one scene, and splits a motion if it is not told how many."""

    def __init__(self, n_motions, seed):
        self.n_motions, self.seed = n_motions, seed

    def fit_predict(self, X):
        if self.n_motions == "auto":
            return np.zeros(len(X), int)
        scenes = scenes_bench.scenes_of("planar", "report")
        return next(s for s in scenes if s.seed == self.seed).target


class Broken:
    def __init__(self, n_motions, seed):
        pass

    def fit_predict(self, X):
        raise RuntimeError("no answer")


def test_the_benchmark_tells_right_from_wrong():
    rows = scenes_bench.run(Oracle, families=["planar"], n_scenes=4, half="report")
    assert len(rows) == 4
    assert all(row["seed"] % 2 == 1 for row in rows)
    assert all(row["known"] == 0 for row in rows)
    assert all(row["unknown"] > 0 and row["count"] == 1 for row in rows)
    assert not any(row["right"] for row in rows)
    line = scenes_bench.summarise(rows)
    assert line["known"] == (0, 0)
    assert line["right"] == (0, 0)


def test_halves_share_no_scene():
    halves = [
        {scene.seed for scene in islice(scenes_bench.scenes_of("table", half), 5)}
        for half in ("tune", "report")
    ]
    assert not halves[0] & halves[1]
    with pytest.raises(ValueError, match=r"half must be one of .*; got 'both'"):
        next(scenes_bench.scenes_of("table", "both"))


def test_some_frame_shows_enough_tracks_of_each_motion():
    def shown(together):
        scenes = scenes_bench.scenes_of("long", together=together, n_frames=60)
        for scene in islice(scenes, 5):
            seen = unpack_tracks(scene.data)[1]
            groups = [scene.target == motion for motion in range(scene.n_motions)]
            yield min(seen[group].sum(axis=0).max() for group in groups)

    assert min(shown(6)) >= 6
    assert min(shown(0)) < 6


def test_failures_are_counted_and_the_rest_goes_on(capsys):
    rows = scenes_bench.run(Broken, families=["table", "planar"], n_scenes=2)
    assert [row["failure"] for row in rows] == ["RuntimeError: no answer"] * 4
    assert all(row["known"] == 1 and not row["right"] for row in rows)
    scenes_bench.show(rows)
    assert "4 failed" in capsys.readouterr().out


def test_scenes_have_the_tracks_and_frames_that_are_asked_for(monkeypatch):
    asked = {}

    def run(**arguments):
        asked.update(arguments)
        return [{"family": "table", "known": 0.0}]

    monkeypatch.setattr(scenes_bench, "run", run)
    monkeypatch.setattr(scenes_bench, "show_line", lambda *_: None)
    monkeypatch.setattr(scenes_bench, "summarise", lambda *_: {})
    scenes_bench.main(["--frames", "24", "60"])
    assert asked["overrides"] == {"n_frames": (24, 60)}
    scenes_bench.main(["--frames", "24", "60", "--tracks", "50", "70"])
    assert asked["overrides"] == {"n_frames": (24, 60), "n_tracks": (50, 70)}
    (scene,) = islice(scenes_bench.scenes_of("table", **asked["overrides"]), 1)
    assert 24 <= scene.data.shape[1] / 2 <= 60
    assert 50 <= len(scene.data) <= 70


def test_both_commands_print_a_line_per_family_and_keep_it(tmp_path, capsys):
    families = ["--scenes", "1", "--families", "two_images", "--json"]
    scenes_bench.main([*families, str(tmp_path / "bench.json"), "--known"])
    first, line, mean = capsys.readouterr().out.splitlines()
    assert first.split() == [
        *("family", "scenes", "known", "unknown"),
        *("right", "rejected", "seconds"),
    ]
    assert line.split()[:2] == ["two_images", "1"]
    assert mean.split()[:2] == ["all", "1"]
    (kept,) = json.loads((tmp_path / "bench.json").read_text())["scenes"]
    assert kept["row"] == "two_images tune"
    assert "known" in kept and "unknown" not in kept

    scene_statistics.main([*families, str(tmp_path / "statistics.json")])
    line = capsys.readouterr().out.splitlines()[1]
    assert line.startswith("two_images")
    kept = json.loads((tmp_path / "statistics.json").read_text())
    assert kept["two_images"]["frames"] == 2


def test_statistics_find_the_noise_that_was_put_in():
    quiet, loud = (
        scene_statistics.describe(scene.data, scene.target, 8)
        for scene in (
            scene_of(
                *("table", 1),
                n_tracks=120,
                n_frames=12,
                noise=noise,
                drift=drift,
                inertia=0.7,
                outliers=0,
                bending=0,
            )
            for noise, drift in ((0.05, 0), (0.5, 1))
        )
    )
    residual, _, correlation, growth, *_ = zip(quiet, loud, strict=True)
    assert 5 < residual[1] / residual[0] < 40
    assert correlation[0] < 0.5 < correlation[1]
    assert growth[0] < 1.4 < growth[1]
