import pytest
import trimesh

from ggcnn_net2net.errors import DataNotFoundError, ObjectSetError
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.simulation.convex import box, write_obj
from ggcnn_net2net.simulation.object_sets import PYBULLET_FOLDERS, load_object_set, make_model


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty user cache, and no reference data."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("GGCNN_NET2NET_DATA", raising=False)
    return tmp_path / "cache" / "ggcnn_net2net"


def test_procedural40_is_made_once(cache):
    first = load_object_set("procedural40")
    assert len(first.objects) == 40
    times = {model.mesh: model.mesh.stat().st_mtime_ns for model in first.objects}
    again = load_object_set("procedural40")
    assert again == first
    assert again.fingerprint == first.fingerprint
    assert times == {model.mesh: model.mesh.stat().st_mtime_ns for model in again.objects}
    assert all(model.mass == model.longest_side for model in again.objects)


def test_pybullet_set_is_the_fixed_list():
    objects = load_object_set("pybullet")
    assert tuple(f"{number:03d}" for number in range(0, 400, 10)) == PYBULLET_FOLDERS
    assert [model.name for model in objects.objects] == [f"random_{number}" for number in PYBULLET_FOLDERS]
    assert all(model.longest_side == pytest.approx(0.25) for model in objects.objects)


def test_ycb40_of_the_reference_data(data_root):
    objects = load_object_set("ycb40")
    assert len(objects.objects) == 40
    banana = next(model for model in objects.objects if model.name == "011_banana")
    assert banana.longest_side == pytest.approx(0.178, abs=0.003)  # metres; true scale


def test_fingerprint_tells_sets_apart(tmp_path):
    write_obj(tmp_path / "a_vhacd.obj", [box((0.1, 0.1, 0.1)), box((0.05, 0.05, 0.1), (0.1, 0, 0))])
    (tmp_path / "objects.csv").write_text("name\na\n")
    plain = load_object_set(str(tmp_path))
    moved = load_object_set(str(tmp_path), CORRECTED)
    (tmp_path / "objects.csv").write_text("name,scale\na,1.1\n")
    scaled = load_object_set(str(tmp_path))
    assert len({plain.fingerprint, moved.fingerprint, scaled.fingerprint}) == 3
    assert scaled.objects[0].longest_side == pytest.approx(1.1 * plain.objects[0].longest_side)


def test_folder_of_other_meshes_is_decomposed(cache, tmp_path):
    trimesh.creation.box((2, 1, 1)).export(tmp_path / "brick.stl")
    (tmp_path / "objects.csv").write_text("name,category,longest_side\nbrick,Brick,0.2\n")
    (model,) = load_object_set(str(tmp_path), PAPER).objects
    assert (model.name, model.category) == ("brick", "Brick")
    assert model.longest_side == pytest.approx(0.2)
    assert cache in model.mesh.parents


def test_a_mesh_without_size_is_refused(tmp_path):
    point = tmp_path / "point.obj"
    point.write_text("o part\n" + "v 1 2 3\n" * 4 + "f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    for size in ({"longest_side": 0.2}, {"scale": 1.0}):
        with pytest.raises(ObjectSetError, match="expected object 'point' with a positive size"):
            make_model("point", "Point", point, PAPER, **size)


def test_shapenetsem_uses_the_papers_scales(cache, tmp_path):
    from ggcnn_net2net.simulation.object_sets import _shapenetsem_rows

    rows = _shapenetsem_rows()
    assert len(rows) == 39
    for row in rows:
        write_obj(tmp_path / f"{row['id']}_vhacd.obj", [box((100, 40, 20))])
    objects = load_object_set(f"shapenetsem:{tmp_path}").objects
    mug = next(model for model in objects if model.category == "Mug")
    assert mug.longest_side == pytest.approx(100 * 0.0013331640511751175)
    (tmp_path / f"{rows[0]['id']}_vhacd.obj").unlink()
    with pytest.raises(ObjectSetError, match=rows[0]["id"]):
        load_object_set(f"shapenetsem:{tmp_path}")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (None, "objects.csv"),
        ("name\n", "name"),
        ("title\nbrick\n", "name"),
        ("name,scale\nbrick,big\n", "numbers"),
        ("name,scale\nbrick,-1\n", "positive"),
        ("name\nghost\n", "ghost"),
    ],
)
def test_bad_folders(tmp_path, table, message):
    write_obj(tmp_path / "brick_vhacd.obj", [box((0.1, 0.1, 0.1))])
    if table is not None:
        (tmp_path / "objects.csv").write_text(table)
    with pytest.raises(ObjectSetError, match=message):
        load_object_set(str(tmp_path))


def test_tables_of_spreadsheets(tmp_path):
    write_obj(tmp_path / "brick_vhacd.obj", [box((0.1, 0.1, 0.1))])
    (tmp_path / "objects.csv").write_text("name\nbrick\n", encoding="utf-8-sig")
    assert [model.name for model in load_object_set(str(tmp_path)).objects] == ["brick"]
    (tmp_path / "objects.csv").write_text("name,category\nbrick,Stück\n", encoding="cp1252")
    with pytest.raises(ObjectSetError, match=r"objects\.csv in UTF-8"):
        load_object_set(str(tmp_path))


@pytest.mark.parametrize("part", [[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 0, 0], [1, 0, 0], [0, 1, 1]]])
def test_parts_without_volume(tmp_path, part):
    lines = ["o part", *(f"v {x} {y} {z}" for x, y, z in part)]
    (tmp_path / "flat_vhacd.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "objects.csv").write_text("name\nflat\n")
    with pytest.raises(ObjectSetError, match="parts with a volume, received part 1 of 1"):
        load_object_set(str(tmp_path), CORRECTED)


@pytest.mark.parametrize("spec", ["procedural41", "pybullet:/tmp", "shapenetsem", "shapenetsem:/nowhere", ""])
def test_unknown_sets(spec):
    with pytest.raises(ObjectSetError, match="expected"):
        load_object_set(spec)


def test_ycb40_that_cannot_be_had_says_how_to_get_it(cache, monkeypatch):
    from ggcnn_net2net.simulation import ycb

    monkeypatch.setattr(ycb, "YCB_URL", "http://127.0.0.1:9/{name}.obj")
    with pytest.raises(DataNotFoundError) as caught:
        load_object_set("ycb40")
    for part in (str(cache), "127.0.0.1:9", "ggcnn-net2net objects ycb40"):
        assert part in str(caught.value)


def test_a_category_of_two_lines_is_refused(tmp_path):
    write_obj(tmp_path / "mug_vhacd.obj", [box((0.1, 0.1, 0.1))])
    (tmp_path / "objects.csv").write_text('name,category\nmug,"one\ntwo"\n')
    with pytest.raises(ObjectSetError, match=r"printable characters .* 'one\\ntwo'"):
        load_object_set(str(tmp_path))


def test_objects_of_one_name_are_refused(tmp_path):
    """Scenes and results are kept by name, so one of the two would be lost."""
    write_obj(tmp_path / "mug_vhacd.obj", [box((0.1, 0.1, 0.1))])
    (tmp_path / "objects.csv").write_text("name,longest_side\nmug,0.1\nmug,0.2\n")
    with pytest.raises(ObjectSetError, match=r"different names .* more than one mug"):
        load_object_set(str(tmp_path))
