"""Sixty scene files from a stranger: each is refused with a named place, nothing runs, nothing outside the folder is read, none is slow."""

import os
import time

import numpy as np
import pytest

from scenes.errors import InputError
from scenes.files import read_scene

HEAD = 'name = "s"\nviewpoint = {kind = "perspective", origin = [0, -3, 1], target = [0, 0, 0], up = [0, 0, 1], fov_deg = 40.0}\n'
RED = '[materials.red]\nkind = "diffuse"\nreflectance = "red"\n'
BALL = '[[shapes]]\nkind = "sphere"\nname = "ball"\nmaterial = "red"\ncenter = [0, 0, 0]\nradius = 1.0\n'
LAMP = '[[lights]]\nkind = "sky"\nradiance = "xenon"\n'
PLACED = 'name = "c"\nmaterial = "red"\ncenter = [0, 0, 0]\nradius = 1.0\n'
GOOD = HEAD + RED + BALL + LAMP


def swap(old, new):
    assert old in GOOD
    return GOOD.replace(old, new)


def material(text):
    return swap('reflectance = "red"', text)


def shape(text):
    return GOOD + "[[shapes]]\n" + text


def mesh(file):
    return shape(f'kind = "mesh"\nname = "m"\nmaterial = "red"\nfile = "{file}"\n')


def texture(weights):
    return GOOD + f'[materials.print]\nkind = "textured"\nbasis = ["red"]\nweights = {weights}\n'


PATHS = {
    "climbs out": "../secret.csv",
    "climbs out below": "a/../../secret.csv",
    "absolute": "/etc/passwd",
    "home": "~/secret.csv",
    "nul": "a\\u0000b.csv",
    "link out": "link.csv",
    "folder link out": "door/secret.csv",
    "a folder": "sub",
    "a pipe": "pipe.csv",
    "a device": "/dev/zero",
    "missing": "missing.csv",
    "a url": "http://127.0.0.1:9/x.csv",
    "empty": "",
    "long": "x" * 5000,
}
TEXTS = {
    "python object": material('reflectance = {csv = "a.csv", __class__ = "os.system"}'),
    "python call": swap('kind = "diffuse"', "kind = \"__import__('os').system('touch ran')\""),
    "plugin": swap('kind = "diffuse"', 'kind = "../../libevil"'),
    "unknown shape": swap('kind = "sphere"', 'kind = "shapegroup"'),
    "include": GOOD + '[include]\nfile = "/etc/passwd"\n',
    "mitsuba type": GOOD + 'type = "scene"\n',
    "format": 'format = "optsim-scene-999"\n' + GOOD,
    "not a number": material("reflectance = nan"),
    "infinity": material("reflectance = inf"),
    "huge": material("reflectance = 1e400"),
    "negative": material("reflectance = -0.5"),
    "over one": material("reflectance = 1.5"),
    "text": material('reflectance = "no such patch"'),
    "list": material("reflectance = [0.1, 0.2]"),
    "boolean": material("reflectance = true"),
    "unsorted": material("reflectance = {wavelength_nm = [500, 400], value = [0.1, 0.2]}"),
    "one node": material("reflectance = {wavelength_nm = [500], value = [0.1]}"),
    "two forms": material('reflectance = {csv = "a.csv", blackbody_K = 5000}'),
    "a million nodes": material("reflectance = {wavelength_nm = [" + "1," * 600_000 + "1], value = [0]}"),
    "cold": swap('radiance = "xenon"', "radiance = {blackbody_K = -5}"),
    "hot": swap('radiance = "xenon"', "radiance = {blackbody_K = 1e300}"),
    "lines without power": swap('radiance = "xenon"', "radiance = {lines_nm = [500, 600], power = [1]}"),
    "no lines": swap('radiance = "xenon"', "radiance = {lines_nm = []}"),
    "radius": swap("radius = 1.0", "radius = 0.0"),
    "radius text": swap("radius = 1.0", 'radius = "1; rm -rf /"'),
    "center": swap("center = [0, 0, 0]", "center = [0, 0]"),
    "far away": swap("center = [0, 0, 0]", "center = [0, 0, 1e300]"),
    "no material": swap('material = "red"', 'material = "../red"'),
    "same name": GOOD + BALL,
    "camera in its target": swap("target = [0, 0, 0]", "target = [0, -3, 1]"),
    "field of view": swap("fov_deg = 40.0", "fov_deg = 180.0"),
    "broken toml": GOOD + "[[[",
    "same table twice": GOOD + RED,
    "same key twice": GOOD + 'name = "t"\n' if False else 'name = "t"\n' + GOOD,
    "deep": "a = " + "[" * 5000 + "]" * 5000 + "\n" + GOOD,
    "wide": GOOD + "\n".join(f"k{i} = 1" for i in range(50_000)),
    "too big": GOOD + "#" * 2_000_000,
    "sections": shape(
        'kind = "cylinder"\nname = "c"\nmaterial = "red"\ncenter = [0,0,0]\nradius = 1.0\nheight = 1.0\nsections = 1000000000\n'
    ),
    "subdivisions": shape('kind = "icosphere"\nname = "c"\nmaterial = "red"\ncenter = [0,0,0]\nradius = 1.0\nsubdivisions = 40\n'),
    "mesh of text": shape('kind = "mesh"\nname = "m"\nmaterial = "red"\nvertices = "x"\nfaces = [[0,1,2]]\n'),
    "mesh out of range": shape(
        'kind = "mesh"\nname = "m"\nmaterial = "red"\nvertices = [[0,0,0],[1,0,0],[0,1,0]]\nfaces = [[0,1,4000000000]]\n'
    ),
    "mesh negative": shape('kind = "mesh"\nname = "m"\nmaterial = "red"\nvertices = [[0,0,0],[1,0,0],[0,1,0]]\nfaces = [[0,1,-1]]\n'),
    "mesh of no format": mesh("a.glb"),
    "archive": mesh("a.zip"),
    "mesh that claims": mesh("claims.ply"),
    "mesh that is text": mesh("a.csv"),
    "texture over one": texture("[[[1.5]]]"),
    "texture outside": texture('"../w.npy"'),
    "texture of objects": texture('"objects.npy"'),
    "texture bomb": texture('"bomb.png"'),
    "texture on a ball": texture("[[[0.5]]]").replace('material = "red"', 'material = "print"'),
    "two skies": GOOD + LAMP,
}
CASES = {f"path: {name}": material(f'reflectance = {{csv = "{path}"}}') for name, path in PATHS.items()} | TEXTS


@pytest.fixture
def folder(tmp_path):
    home = tmp_path / "home"
    (home / "sub").mkdir(parents=True)
    (tmp_path / "secret.csv").write_text("wavelength_nm,value\n300,0.123\n900,0.123\n")
    np.save(tmp_path / "w.npy", np.full((1, 1, 1), 0.123))
    (home / "a.csv").write_text("wavelength_nm,value\n300,0.5\n900,0.5\n")
    (home / "link.csv").symlink_to(tmp_path / "secret.csv")
    (home / "door").symlink_to(tmp_path)
    os.mkfifo(home / "pipe.csv")
    coordinates = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n{coordinates}end_header\n"
    (home / "claims.ply").write_bytes(head.encode() + b"\0" * 64)
    np.save(home / "objects.npy", np.array([[[{"a": 1}]]], object), allow_pickle=True)
    (home / "bomb.png").write_bytes(_bomb())
    for name in ("a.glb", "a.zip"):
        (home / name).write_bytes(b"PK\x03\x04" + b"\0" * 100)
    return home


def _bomb():
    """A PNG header that claims 60,000 x 60,000 pixels."""
    import struct
    import zlib

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 1000)) + chunk(b"IEND", b"")


def test_there_are_sixty_of_them_and_the_plain_one_is_fine(folder):
    assert len(CASES) >= 60
    (folder / "scene.toml").write_text(GOOD)
    assert read_scene(folder / "scene.toml").name == "s"


@pytest.mark.parametrize("name", CASES)
def test_a_hostile_scene_file_is_refused_by_place_quickly_and_without_running_anything(folder, name, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "scene.toml").write_text(CASES[name])
    before = sorted(p.name for p in folder.iterdir())
    start = time.process_time()
    with pytest.raises(InputError) as caught:
        read_scene(folder / "scene.toml")
    assert time.process_time() - start < 10
    assert caught.value.field
    assert "0.123" not in str(caught.value)
    assert len(str(caught.value)) < 4000
    assert sorted(p.name for p in folder.iterdir()) == before
