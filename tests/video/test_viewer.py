"""The page to look at a segmentation, as text and in a real browser."""

from __future__ import annotations

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from skmotionseg.video import write_viewer

pytest.importorskip("cv2", reason="needs opencv-python-headless")

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
N_FRAMES = 5

# What a user does: looks, scrubs, clicks on a point, clicks beside all points, and
# switches the mask and the trails of a motion off and on.
USE = """
<script>
(async () => {
  const seen = {}, pen = view.getContext("2d");
  const at = (x, y) => Array.from(pen.getImageData(x, y, 1, 1).data.slice(0, 3));
  const click = (x, y) => {
    const box = view.getBoundingClientRect();
    view.dispatchEvent(new MouseEvent("click", {
      clientX: box.left + x * box.width / data.width,
      clientY: box.top + y * box.height / data.height,
    }));
    return said.textContent;
  };
  const after = () => new Promise(done => setTimeout(done, 300));
  const toggle = async id => { document.getElementById(id).click(); await after(); };
  await viewer.go(0); seen.number = document.getElementById("number").textContent;
  seen.masked = at(30, 20); seen.bare = at(70, 50);
  slider.value = 3; slider.dispatchEvent(new Event("input")); await after();
  seen.later = document.getElementById("number").textContent;
  seen.point = click(33, 30); seen.nothing = click(5, 55);
  await toggle("masks1"); seen.off = at(30, 20);
  await toggle("masks1"); seen.on = at(30, 20);
  await toggle("trails1"); seen.hidden = click(33, 30);
  const result = document.createElement("pre");
  result.id = "result"; result.textContent = JSON.stringify(seen);
  document.body.append(result);
})();
</script>
"""


@pytest.fixture
def page(tmp_path):
    """A page of a grey video with a mask, a point on it and one in the scene."""
    frames = np.full((N_FRAMES, 60, 80), 100, np.uint8)
    masks = np.zeros((N_FRAMES, 60, 80), np.uint8)
    masks[:, 10:40, 20:50] = 1
    X = np.full((3, 2 * N_FRAMES), np.nan)
    X[0] = np.column_stack([30 + np.arange(N_FRAMES), np.full(N_FRAMES, 30)]).ravel()
    X[1], X[2, :4] = np.tile([60, 50], N_FRAMES), [10, 10, 10, 11]
    out = tmp_path / "a <b>.html"
    sure = [0.9, 0.8, np.nan]
    write_viewer(frames, X, [1, 0, -1], out, masks=masks, probabilities=sure)
    return out


def data_of(page):
    found = re.search(r'type="application/json">(.*?)</script>', page.read_text(), re.S)
    return json.loads(found.group(1))


def test_a_page_needs_nothing_else(page):
    text = page.read_text()
    assert "<title>skmotionseg: a &lt;b&gt;</title>" in text
    assert not re.search(r"https?://|src=|href=|@import", text)
    data = data_of(page)
    assert len(data["images"]) == len(data["masks"]) == N_FRAMES
    assert data["motions"] == [-1, 0, 1]
    assert (data["width"], data["height"]) == (80, 60)
    assert [track["motion"] for track in data["tracks"]] == [-1, 0, 1]
    assert [track["probability"] for track in data["tracks"]] == [None, 0.8, 0.9]
    assert len(data["tracks"][0]["places"]) == 2
    assert data["tracks"][2]["places"][3] == [33.5, 30.5]


def test_motions_of_masks_can_be_switched_on(tmp_path):
    masks = np.full((2, 20, 20), 9, dtype=np.uint8)
    out = tmp_path / "page.html"
    write_viewer(np.zeros_like(masks), np.ones((1, 4)), [0], out, masks=masks)
    assert data_of(out)["motions"] == [0, 9]


def test_a_page_of_many_tracks_draws_some_of_each_motion(tmp_path):
    X = np.random.default_rng(0).uniform(0, 60, (5000, 4))
    labels = np.repeat([0, 1, -1], [4900, 60, 40])
    write_viewer(np.zeros((2, 64, 64), np.uint8), X, labels, tmp_path / "many.html")
    tracks = data_of(tmp_path / "many.html")["tracks"]
    counts = np.unique([track["motion"] for track in tracks], return_counts=True)[1]
    assert 2990 < len(tracks) < 3010 and counts.min() >= 24
    assert all(track["residual"] > 0 for track in tracks if track["motion"] >= 0)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"labels": [0]}, "3 tracks need one label each"),
        ({"X": np.empty((3, 0))}, r"one frame or more; got an array of shape \(3, 0\)"),
        ({"probabilities": [0.5]}, "3 tracks need one probability each"),
        ({"probabilities": [0.5, np.nan, 7]}, "from 0 to 1; got 7.0"),
        ({"probabilities": [0.5, -np.inf, 1]}, "from 0 to 1; got -inf"),
        ({"out": "page.htm"}, "end in .html"),
        ({"masks": []}, "frame 0 needs a mask"),
    ],
)
def test_pages_that_cannot_be(tmp_path, change, words):
    given = {"X": np.ones((3, 4)), "labels": [0, 0, 1], "out": "page.html", **change}
    given["out"] = tmp_path / given["out"]
    with pytest.raises(ValueError, match=words):
        write_viewer(np.zeros((2, 20, 20), np.uint8), **given)
    assert not list(tmp_path.iterdir())


def test_a_page_works_in_a_browser(page, tmp_path):
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser to open the page in: none of {', '.join(BROWSERS)}")
    used = tmp_path / "used.html"
    used.write_text(page.read_text().replace("</body>", USE + "</body>"))
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    options += [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=9000"]
    done = subprocess.run(
        [browser, *options, used.as_uri()], capture_output=True, text=True, timeout=120
    )
    result = re.search(r'<pre id="result">(.*?)</pre>', done.stdout, re.S)
    assert result, done.stderr[-2000:]
    seen = json.loads(result.group(1))
    assert seen["number"] == "frame 0 of 5" and seen["later"] == "frame 3 of 5"
    assert np.ptp(seen["bare"]) < 12 and np.ptp(seen["masked"]) > 30
    assert seen["point"] == "motion 1; probability 0.90"
    assert seen["nothing"] == "No point is near."
    assert np.ptp(seen["off"]) < 12 and seen["on"] == seen["masked"]
    assert seen["hidden"] == "No point is near."
