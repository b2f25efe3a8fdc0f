"""Pictures are there, hold what they should, and their texts do not overlap."""

from __future__ import annotations

import itertools
import re
from xml.etree import ElementTree

import cv2
import pytest
from journals import MadeUpNetworks, by_hand, lookahead, place, scored, start
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ggcnn_net2net.search.history import read_history
from ggcnn_net2net.search.pictures import write_depth_chart, write_size_chart, write_tree
from ggcnn_net2net.search.settings import SearchSettings


def large_search(**settings):
    return read_history(MadeUpNetworks(SearchSettings(**settings), failing=0.04).run())


def texts_of(svg):
    return [element.text for element in ElementTree.parse(svg).iter("{http://www.w3.org/2000/svg}text")]


def test_the_svg_of_the_tree_has_every_operation_score_and_size(tmp_path):
    history = large_search()
    write_tree(history, tmp_path / "tree.svg")
    texts = texts_of(tmp_path / "tree.svg")
    words = list(itertools.chain.from_iterable(text.split("  ") for text in texts))
    for name in {candidate.operation for candidate in history.candidates.values()} - {"root"}:
        assert texts.count(name) == sum(candidate.operation == name for candidate in history.candidates.values())
    scores = [history.score_text(item.score) for item in history.candidates.values() if item.state != "failed"]
    for score in set(scores):
        assert words.count(score) == scores.count(score)
    assert words.count("failed") == len(history.failed) + 1  # the legend
    sizes = [f"{item.parameters:,}" for item in history.candidates.values()]
    assert all(words.count(size) == sizes.count(size) for size in set(sizes))


def test_the_same_tree_gives_the_same_file(tmp_path):
    history = read_history(by_hand())
    write_tree(history, tmp_path / "a.svg", tmp_path / "b.svg")
    assert without_date(tmp_path / "a.svg") == without_date(tmp_path / "b.svg")


def without_date(path):
    return re.sub(r"<dc:date>.*</dc:date>", "", path.read_text())


@pytest.mark.parametrize("settings", [{}, {"retrain": 8}, {"lookahead": False}], ids=str)
def test_texts_and_boxes_of_the_tree_do_not_overlap(tmp_path, monkeypatch, settings):
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (figures.append(figure), path.touch()))
    write_tree(large_search(**settings), tmp_path / "tree.png")
    [figure] = figures
    renderer = FigureCanvasAgg(figure).get_renderer()
    [axes] = figure.axes
    boxes = [patch.get_window_extent(renderer) for patch in axes.patches]
    texts = [text.get_window_extent(renderer) for text in axes.texts]
    assert not overlapping(texts)
    assert not overlapping(boxes)
    for text in texts:  # inside of one box, or outside of all
        assert sum(box.overlaps(text) for box in boxes) == sum(within(text, box) for box in boxes)


def overlapping(areas):
    """Pairs that share a point; sorted from top to bottom, so that only neighbours need be compared."""
    found = []
    for one, other in itertools.combinations(areas, 2):
        if one.x0 < other.x1 and other.x0 < one.x1 and one.y0 < other.y1 and other.y0 < one.y1:
            found.append((one, other))
    return found


def within(inner, outer):
    return outer.x0 <= inner.x0 and inner.x1 <= outer.x1 and outer.y0 <= inner.y0 and inner.y1 <= outer.y1


def test_png_of_a_large_tree_is_bounded(tmp_path):
    write_tree(large_search(width=8, depth=6), tmp_path / "tree.png")
    picture = cv2.imread(str(tmp_path / "tree.png"))
    assert 9000 < max(picture.shape) <= 10_000
    assert picture.std() > 5


@pytest.mark.parametrize("write", [write_depth_chart, write_size_chart, write_tree])
@pytest.mark.parametrize("length", [1, 2, 4, 13])
def test_pictures_of_unfinished_searches(tmp_path, write, length):
    write(read_history(by_hand()[:length]), tmp_path / "picture.png")
    picture = cv2.imread(str(tmp_path / "picture.png"))
    assert picture.std() > 1


@pytest.mark.parametrize(
    ("heuristic", "label"), [("iou", "IoU rate"), ("loss", "test loss"), ("sim", "success rate in simulation")]
)
def test_the_chart_says_what_the_score_is(tmp_path, monkeypatch, heuristic, label):
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (figures.append(figure), path.touch()))
    events = by_hand()
    events[0] = start(SearchSettings(width=2, depth=2, heuristic=heuristic))
    write_depth_chart(read_history(events), tmp_path / "chart.png")
    axes = figures[0].axes[0]
    assert axes.get_ylabel() == label
    [path] = [line for line in axes.lines if line.get_label() == "committed path"]
    assert [*zip(*path.get_data(), strict=True)] == [(0, 0.5), (1, 0.6), (2, 0.8)]
    assert [text.get_text() for text in axes.texts] == ["1,000", "1,200", "1,250"]
    assert sum(len(dots.get_offsets()) for dots in axes.collections) == 6  # one has failed


def test_the_front_and_the_path_are_in_the_chart_of_sizes(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (figures.append(figure), path.touch()))
    write_size_chart(read_history(by_hand()), tmp_path / "chart.png")
    lines = {line.get_label(): [*zip(*line.get_data(), strict=True)] for line in figures[0].axes[0].lines}
    assert lines["Pareto front"] == [(1000, 0.5), (1100, 0.7), (1250, 0.8)]
    assert lines["committed path"] == [(1000, 0.5), (1200, 0.6), (1250, 0.8)]
    assert lines["root"] == [(1000, 0.5)]


def test_pruned_candidates_are_dashed_in_the_tree_and_missing_in_the_charts(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (figures.append(figure), path.touch()))
    events = [start(SearchSettings(width=1, depth=1, halving=True)), scored("root", None, "root", 0.5, epochs=0)]
    events += [scored("a", "root", "deeper(1)", 0.9, epochs=1), scored("b", "root", "wider(1)", 0.7)]
    events.append(lookahead(0, "root", [[place("b", 0.7, kept=True), place("a", 0.9, pruned=True)]], ["b"]))
    history = read_history(events)
    write_tree(history, tmp_path / "tree.png")
    write_depth_chart(history, tmp_path / "chart.png")
    assert [patch.get_linestyle() for patch in figures[0].axes[0].patches].count("--") == 1
    assert sum(len(dots.get_offsets()) for dots in figures[1].axes[0].collections) == 2
