"""Pages, README and metadata keep up with the package."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from helpers.public_names import NAMES

import skmotionseg

ROOT = Path(skmotionseg.__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(ROOT.glob("docs/**/*.md")),
]


def test_the_api_reference_lists_every_public_name_once():
    listed, module = [], None
    for line in (ROOT / "docs/api.md").read_text().splitlines():
        if line.startswith(".. currentmodule:: "):
            module = line.split()[-1]
        elif name := re.fullmatch(r"   (\w+)", line):
            listed.append(f"{module}.{name[1]}")
    assert sorted(listed) == sorted(NAMES)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_to_files_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    made = ROOT / "docs" / "gallery"  # by Sphinx, of examples/gallery
    for link in links:
        target = (page.parent / link).resolve()
        if made in target.parents:
            target = ROOT / "examples" / "gallery" / (target.stem + ".py")
        assert "://" in link or target.exists(), link


def test_constants_that_the_method_names_are_found_in_one_module():
    code = [
        (path.stem, re.findall(r"^[A-Z][A-Z0-9_, ]+(?==|: )", path.read_text(), re.M))
        for path in (ROOT / "skmotionseg").rglob("*.py")
    ]
    defined = {
        (module, name)
        for module, lines in code
        for line in lines
        for name in line.strip().split(", ")
    }
    method = (ROOT / "docs/method.md").read_text()
    named = re.findall(r"`(?:([a-z_]+)\.)?([A-Z][A-Z0-9_]+)`", method)
    assert len(named) > 50
    for module, name in named:
        modules = [m for m, n in defined if n == name and module in ("", m)]
        assert len(modules) == 1, (name, modules)


def test_the_citation_is_of_this_version():
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {skmotionseg.__version__}\n" in citation


def test_the_code_of_the_readme_runs_and_is_that_of_the_first_page(capsys):
    shown = [
        re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)
        for page in ("README.md", "docs/index.md")
    ]
    assert shown[0] == shown[1]
    (code,) = shown[0]
    names: dict = {}
    exec(code, names)
    assert names["segmenter"].n_motions_ == 3
    assert "3 motions in 120 tracks" in capsys.readouterr().out
