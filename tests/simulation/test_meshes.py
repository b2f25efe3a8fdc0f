import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.errors import ObjectSetError
from ggcnn_net2net.simulation.convex import box, cylinder, write_obj
from ggcnn_net2net.simulation.meshes import centre_of_mass, convex_decomposition, extents, read_parts, vertex_mean

triples = st.tuples(*[st.floats(0.05, 2)] * 3)


def test_read_parts_gives_what_was_written(tmp_path):
    parts = [box((0.1, 0.2, 0.3)), cylinder(0.05, 0.4)]
    write_obj(tmp_path / "two.obj", parts)
    read = read_parts(tmp_path / "two.obj")
    assert len(read) == 2
    for part, again in zip(parts, read, strict=True):
        np.testing.assert_allclose(again.min(axis=0), part.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(again.max(axis=0), part.max(axis=0), atol=1e-6)


def test_a_mesh_without_groups_is_one_part(tmp_path):
    (tmp_path / "plain.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")
    assert [part.shape for part in read_parts(tmp_path / "plain.obj")] == [(4, 3)]


@pytest.mark.parametrize("text", ["", "o empty\n", "v 0 0 nan\n", "v 0 zero 0\n"])
def test_meshes_without_finite_vertices_are_refused(tmp_path, text):
    (tmp_path / "bad.obj").write_text(text)
    with pytest.raises(ObjectSetError, match=r"bad\.obj"):
        read_parts(tmp_path / "bad.obj")


@given(triples, triples)
def test_centre_of_mass_of_a_box(size, offset):
    np.testing.assert_allclose(centre_of_mass([box(size, offset)]), offset, atol=1e-9)


def test_centre_of_mass_weighs_by_volume_and_vertex_mean_does_not():
    parts = [box((1, 1, 1)), box((2, 1, 1), (10, 0, 0)), cylinder(1e-3, 1e-3, (0, 0, 50))]
    np.testing.assert_allclose(centre_of_mass(parts), (20 / 3, 0, 0), atol=1e-5)
    vertices = np.concatenate(parts)
    np.testing.assert_allclose(vertex_mean(parts), vertices.mean(axis=0))
    assert vertex_mean(parts)[2] > 20  # drawn to the tiny, finely cut cylinder


def test_extents():
    np.testing.assert_allclose(extents([box((1, 2, 3)), box((1, 1, 1), (5, 0, 0))]), (6, 2, 3))


def test_decomposition_makes_a_torus_hollow_once(tmp_path):
    mesh = tmp_path / "ring.stl"
    trimesh.creation.torus(0.1, 0.03).export(mesh)
    convex = convex_decomposition(mesh, tmp_path / "cache")
    parts = read_parts(convex)
    assert len(parts) > 4
    np.testing.assert_allclose(extents(parts), (0.26, 0.26, 0.06), atol=0.01)
    assert all(np.abs(part.mean(axis=0)[:2]).max() > 0.03 for part in parts)  # nothing in the hole
    before = convex.stat().st_mtime_ns
    assert convex_decomposition(mesh, tmp_path / "cache") == convex
    assert convex.stat().st_mtime_ns == before


def test_decomposition_of_nonsense(tmp_path):
    (tmp_path / "bad.stl").write_text("not a mesh")
    with pytest.raises(ObjectSetError, match=r"bad\.stl"):
        convex_decomposition(tmp_path / "bad.stl", tmp_path / "cache")
    assert not list((tmp_path / "cache").glob("*")) if (tmp_path / "cache").exists() else True
