"""Procedural meshes against closed forms; mesh files that lie are refused before they are read."""

import os

import numpy as np
import pytest

from scenes.errors import InputError
from scenes.meshes import cylinder, icosphere, read_mesh, torus

PLY = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def put(folder, name, data):
    path = folder / name
    path.write_bytes(data)
    return path


def test_procedural_solids_face_outwards_and_have_the_volume_of_their_facets():
    n = 96
    prism = n / 2 * np.sin(2 * np.pi / n)
    assert volume(cylinder("c", "m", (0.5, 2.0), (1, 2, 3), n)) == pytest.approx(prism * 0.25 * 2.0)
    assert volume(torus("t", "m", (2.0, 0.5), (0, 0, 0), 128)) == pytest.approx(2 * np.pi**2 * 2.0 * 0.25, rel=2e-3)
    assert volume(icosphere("i", "m", 1.5, (5, 0, 0), 4)) == pytest.approx(4 / 3 * np.pi * 1.5**3, rel=5e-3)


def test_a_rigid_transform_moves_a_mesh_and_anything_else_is_refused():
    turn = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1.0]])
    plain, moved = (torus("t", "m", (2.0, 0.5), place, 8) for place in ((0, 0, 0), turn))
    np.testing.assert_allclose(moved.vertices, plain.vertices @ turn[:3, :3].T + turn[:3, 3], atol=1e-12)
    with pytest.raises(InputError, match="rigid"):
        torus("t", "m", (2.0, 0.5), np.diag([2.0, 1, 1, 1]), 8)


def test_procedural_solids_refuse_impossible_sizes():
    for make in (
        lambda: torus("t", "m", (0.5, 1.0), (0, 0, 0)),
        lambda: cylinder("c", "m", (0.0, 1.0), (0, 0, 0)),
        lambda: cylinder("c", "m", (1.0, 1.0), (0, 0, 0), 2),
        lambda: icosphere("i", "m", 1.0, (0, 0, 0), 99),
    ):
        with pytest.raises(InputError):
            make()


@pytest.mark.parametrize("kind", ["ply", "obj", "stl"])
def test_a_mesh_file_reads_back_as_it_was_written(tmp_path, kind):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((1, 2, 3))
    box.export(tmp_path / f"box.{kind}")
    mesh = read_mesh(tmp_path / f"box.{kind}", "box", "m", metres_per_unit=0.5)
    assert volume(mesh) == pytest.approx(6 / 8, rel=1e-6)
    np.testing.assert_allclose(mesh.bounds(), [[-0.25, -0.5, -0.75], [0.25, 0.5, 0.75]], rtol=1e-6)


def test_I9_a_ply_with_an_index_out_of_range_is_refused_with_its_face(tmp_path):
    for index in (b"7", b"-1"):
        path = put(tmp_path, "bad.ply", PLY.replace(b"3 0 1 2", b"3 0 1 " + index))
        with pytest.raises(InputError, match="first bad face is number 0"):
            read_mesh(path, "m", "m")


def test_I9_a_ply_with_a_vertex_that_is_no_number_is_refused(tmp_path):
    with pytest.raises(InputError, match="first bad vertex is number 1"):
        read_mesh(put(tmp_path, "nan.ply", PLY.replace(b"1 0 0", b"1 nan 0")), "m", "m")


def test_I9_a_ply_without_faces_is_refused(tmp_path):
    with pytest.raises(InputError):
        read_mesh(put(tmp_path, "none.ply", PLY.replace(b"face 1", b"face 0").replace(b"3 0 1 2\n", b"")), "m", "m")


def test_I9_a_ply_that_declares_four_billion_vertices_is_refused_before_it_is_read(tmp_path):
    for count in (b"4000000000", b"99", b"-3", b"x"):
        with pytest.raises(InputError, match="its header declares"):
            read_mesh(put(tmp_path, "big.ply", PLY.replace(b"vertex 3", b"vertex " + count)), "m", "m")


def test_a_file_that_is_cut_or_is_no_mesh_is_refused(tmp_path):
    import trimesh

    trimesh.creation.icosphere(1).export(tmp_path / "ball.stl")
    trimesh.creation.icosphere(1).export(tmp_path / "ball.ply")
    for name in ("ball.stl", "ball.ply"):
        data = (tmp_path / name).read_bytes()
        for cut in range(0, len(data), len(data) // 16):
            with pytest.raises(InputError):
                read_mesh(put(tmp_path, "cut" + name, data[:cut]), "m", "m")
    with pytest.raises(InputError):
        read_mesh(put(tmp_path, "noise.obj", bytes(range(256))), "m", "m")
    with pytest.raises(InputError):
        read_mesh(put(tmp_path, "empty.obj", b""), "m", "m")


def test_I10_archives_folders_pipes_and_devices_are_refused(tmp_path):
    for name in ("model.zip", "model.gltf", "model"):
        with pytest.raises(InputError, match=r"\.ply, \.obj, \.stl"):
            read_mesh(put(tmp_path, name, b"x"), "m", "m")
    (tmp_path / "folder.ply").mkdir()
    os.mkfifo(tmp_path / "pipe.ply")
    (tmp_path / "zero.ply").symlink_to("/dev/zero")
    for name in ("folder.ply", "pipe.ply", "zero.ply"):
        with pytest.raises(InputError, match="regular file"):
            read_mesh(tmp_path / name, "m", "m")
    with pytest.raises(InputError, match="can be read"):
        read_mesh(tmp_path / "absent.ply", "m", "m")
