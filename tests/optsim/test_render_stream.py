"""Cubes rendered part by part: the bytes of a render in one piece, on disk, resumed, within little memory."""

import json
import subprocess
import sys

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.files import NetcdfSink, read_cube
from optsim.render import RenderSettings, render, render_to
from optsim.render import flat as flat_module
from scenes.catalogue import scene_by_name
from scenes.color_checker import ColorChecker
from scenes.scene import Sphere

BANDS = Bands.paper()
FLAT = ColorChecker().build()
CHART = FLAT.model_copy(update={"shapes": (*FLAT.shapes, Sphere(name="speck", material="board", center=(0, 0, -0.01), radius=1e-4))})
SAME = {"error", "error_low", "error_high", "error_by_band"}
"""Attributes that are sums over parts: equal to rounding."""


def require_equal(streamed, whole):
    for name in whole.data_vars:
        assert streamed[name].values.tobytes() == whole[name].values.tobytes()
    assert set(streamed.data_vars) == set(whole.data_vars)
    assert {k: v for k, v in streamed.attrs.items() if k not in SAME} == {k: v for k, v in whole.attrs.items() if k not in SAME}
    for name in ("error", "error_low", "error_high"):
        assert streamed.attrs.get(name, 0) == pytest.approx(whole.attrs.get(name, 0), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("chart", {"samples_per_pixel": 1}),
        ("chart", {"samples_per_pixel": 8}),
        ("chart", {"error": 0.5}),
        ("chart", {"error": 0.02}),
        ("relief", {"error": 0.1}),
    ],
    ids=str,
)
def test_parts_give_the_bytes_of_the_whole(tmp_path, name, settings):
    scene = CHART if name == "chart" else scene_by_name("relief").build()
    size, chosen = (70, 40), RenderSettings(seed=5, **settings)
    whole = render(scene, BANDS, size, chosen)
    render_to(NetcdfSink(tmp_path / "cube.nc"), scene, BANDS, size, chosen, memory=1)
    require_equal(read_cube(tmp_path / "cube.nc"), whole)
    assert [p.name for p in tmp_path.iterdir()] == ["cube.nc"]


def test_strips_of_a_flat_picture_give_the_bytes_of_the_whole(tmp_path, monkeypatch):
    whole = render(FLAT, BANDS, (50, 40))
    monkeypatch.setattr(flat_module, "PIXELS_A_STRIP", 40 * 7)
    render_to(NetcdfSink(tmp_path / "cube.nc", {"bands": "paper"}), FLAT, BANDS, (50, 40))
    require_equal(read_cube(tmp_path / "cube.nc"), whole.assign_attrs(bands="paper"))


def test_an_interrupted_stream_takes_up_where_it_stopped(tmp_path):
    size, settings, file = (100, 40), RenderSettings(error=0.02, seed=1), tmp_path / "cube.nc"
    whole = render(CHART, BANDS, size, settings)
    seen = []

    def interrupt(done, error):
        seen.append(done)
        if done > 0.5:
            raise KeyboardInterrupt

    sink = NetcdfSink(file)
    with pytest.raises(KeyboardInterrupt):
        render_to(sink, CHART, BANDS, size, settings, progress=interrupt, memory=1)
    sink.close()
    assert not file.exists()
    again = []
    render_to(NetcdfSink(file), CHART, BANDS, size, settings, progress=lambda done, error: again.append(done), memory=1)
    assert len([x for x in again if x > 0]) == 2  # of four parts two were there
    assert again[-1] == 1
    require_equal(read_cube(file), whole)


def test_rows_of_another_render_or_a_broken_file_are_not_taken_up(tmp_path):
    file, part = tmp_path / "cube.nc", tmp_path / ".cube.nc.part"
    sink = NetcdfSink(file)
    sink.begin((4, 2, 24), BANDS, np.float32, False, "one")
    sink.rows(0, np.ones((3, 2, 24)), None, np.array([1.0, 2.0]))
    sink.close()
    same = NetcdfSink(file)
    rows, notes = same.begin((4, 2, 24), BANDS, np.float32, False, "one")
    same.close()
    assert (rows, notes.tolist()) == (3, [1.0, 2.0])
    other = NetcdfSink(file)
    assert other.begin((4, 2, 24), BANDS, np.float32, False, "two")[0] == 0
    other.close()
    part.write_bytes(part.read_bytes()[:100])
    broken = NetcdfSink(file)
    assert broken.begin((4, 2, 24), BANDS, np.float32, False, "two")[0] == 0
    broken.close()


STREAM = """
import json, resource, sys
import numpy as np
from optsim.cube import Bands
from optsim.files import NetcdfSink
from optsim.render import RenderSettings, render_to
from scenes.catalogue import scene_by_name
bands = Bands.from_edges(np.linspace(450, 670, 241))
scene = scene_by_name("relief").build()
peak = []
for side in (32, int(sys.argv[1])):
    render_to(NetcdfSink(sys.argv[2]), scene, bands, (side, side), RenderSettings(samples_per_pixel=1), memory=2**26)
    peak.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
print(json.dumps(peak))
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_cube(tmp_path):
    run = subprocess.run([sys.executable, "-c", STREAM, "768", str(tmp_path / "cube.nc")], capture_output=True, text=True, check=True)
    small, large = json.loads(run.stdout)
    cube = 768 * 768 * 240 * 4 / 2**20
    assert (tmp_path / "cube.nc").stat().st_size > cube * 2**20
    assert large - small < 0.6 * cube  # in one piece the float64 accumulators and the cube itself would take 5 times its size


def test_the_command_streams_large_cubes_and_writes_the_same_file(tmp_path, monkeypatch, capsys):
    from optsim.cli import render as command

    for name, limit in (("whole.nc", 2**28), ("streamed.nc", 1)):
        monkeypatch.setattr(command, "STREAMED_VALUES", limit)
        command.render("relief", output=tmp_path / name, size=8, spp=4)
        assert "4 paths a pixel" in capsys.readouterr().err
    require_equal(read_cube(tmp_path / "streamed.nc"), read_cube(tmp_path / "whole.nc"))
