"""The gallery shows every scene that comes with the program, small enough to be read in a browser."""

import json
from pathlib import Path

import pytest
from PIL import Image

from scenes import SCENES

GALLERY = Path(__file__).parents[2] / "docs" / "gallery"
PAGE = (GALLERY / "README.md").read_text(encoding="utf-8")
ENTRIES = json.loads((GALLERY / "gallery.json").read_text())


@pytest.mark.parametrize("name", [recipe.name for recipe in SCENES] + ["still-life"])
def test_a_scene_stands_in_the_gallery_with_picture_command_error_and_what_it_requires(name):
    assert f"\n## {name}\n" in PAGE
    entry = ENTRIES[name]
    assert 0 < entry["error"] <= entry["asked"]
    assert entry["cpu_s"] > 0
    for picture in entry["pictures"]:
        assert f"]({picture})" in PAGE
        assert Image.open(GALLERY / picture).size == (256, 256)
    for command in entry["commands"]:
        assert f"    {command}\n" in PAGE
    assert entry["explain"].rstrip() in PAGE


def test_the_gallery_holds_no_other_pictures_and_less_than_3_megabytes():
    files = {path.name: path.stat().st_size for path in GALLERY.glob("*.png")}
    assert set(files) == {picture for entry in ENTRIES.values() for picture in entry["pictures"]}
    assert sum(files.values()) < 3e6
