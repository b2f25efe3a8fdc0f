import csv
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net import zoo
from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.reproduce.curve_report import conditions, not_run, write_report
from ggcnn_net2net.reproduce.curves import (
    COLUMNS,
    IOU,
    SCORE,
    SIM,
    CurvePoint,
    paper_readings,
    read_points,
    results_of,
    shipped_points,
    write_points,
)
from ggcnn_net2net.reproduce.experiments import EXPERIMENTS
from ggcnn_net2net.search import SearchSettings

FIG2 = EXPERIMENTS["fig2"]
POINT = CurvePoint(
    *("fig2", "e=2", "PAPER", SIM, 4, 0.835, 167, 200, 67_644, "C9x9x32_T9x9x32", "deeper(3)", 0),
    *("standard", "procedural40, 5 pose(s) each", "published"),
)
WORDS = st.text(st.characters(codec="utf-8", exclude_characters="\r\n\x00"), max_size=8)


def curve_of(name="e=2", protocol="PAPER", figure="fig2", depth=5):
    """Made-up points of all metrics."""
    place = replace(POINT, figure=figure, curve=name, protocol=protocol)
    for number in range(depth + 1):
        yield replace(place, depth=number, successes=150 + number, value=(150 + number) / 200)
        yield replace(place, metric=IOU, depth=number, successes=60, trials=90, value=60 / 90, objects="boxes.h5")
        yield replace(place, metric=SCORE, depth=number, successes=None, trials=None, value=0.7)


@given(
    st.builds(
        CurvePoint,
        *(WORDS, WORDS, WORDS, st.sampled_from([IOU, SIM, SCORE]), st.integers(0, 9), st.floats(0, 1)),
        *(st.none() | st.integers(0, 9), st.none() | st.integers(1, 9), st.integers(1), WORDS, WORDS),
        *(st.integers(0), WORDS, WORDS, WORDS),
    )
)
def test_points_survive_the_file(tmp_path_factory, point):
    path = tmp_path_factory.mktemp("points") / "results.csv"
    write_points(path, [point])
    assert read_points(path) == [point]


@pytest.mark.parametrize(
    "text", ["", "curve,value\n", ",".join(COLUMNS) + "\nfig2,x\n", ",".join(COLUMNS) + "\n" + "x," * 15]
)
def test_a_csv_of_something_else(tmp_path, text):
    (tmp_path / "results.csv").write_text(text)
    with pytest.raises(ResultsError, match=r"results\.csv"):
        read_points(tmp_path / "results.csv")


def test_a_csv_in_another_encoding(tmp_path):
    text = ",".join(COLUMNS) + "\nStück"
    for encoding in ("cp1252", "utf-16"):
        (tmp_path / "results.csv").write_bytes(text.encode(encoding))
        with pytest.raises(ResultsError, match=r"results\.csv.*codec"):
            read_points(tmp_path / "results.csv")


def test_the_papers_readings():
    readings = paper_readings()
    assert set(readings) == {
        (figure, curve.name) for figure in ("fig2", "fig3") for curve in EXPERIMENTS[figure].curves
    }
    assert all(len(values) == 12 for values in readings.values())
    best = readings["fig2", "e=2"]
    assert (best[SIM, 0], best[SIM, 4]) == (0.785, 0.835)  # Table I
    for values in readings.values():
        for (metric, _), value in values.items():
            if metric == SIM:  # of 200 grasps
                assert value * 200 == pytest.approx(round(value * 200), abs=1e-9)


def test_what_ships_can_be_read():
    for point in shipped_points():
        assert point.figure in EXPERIMENTS
        assert point.metric in (IOU, SIM, SCORE)
        if point.interval is not None:
            assert point.value == pytest.approx(point.successes / point.trials)


def test_the_search_of_the_zoo_has_the_papers_form():
    found = zoo.provenance("searched_extended")["search"]
    assert SearchSettings.from_dict(found["settings"]) == FIG2.curves[0].settings("standard", CORRECTED, 0, 1, 67_644)


def test_shipped_curves_are_whole_and_those_of_a_protocol_start_alike():
    curves = {}
    for point in shipped_points():
        curves.setdefault((point.figure, point.curve, point.protocol), []).append(point)
    starts = {}
    for (_, _, protocol), points in curves.items():
        assert sorted((point.metric, point.depth) for point in points) == sorted(
            (metric, depth) for metric in (IOU, SIM, SCORE) for depth in range(6)
        )
        assert len({(point.budget, point.seed, point.network) for point in points}) == 1
        (start,) = [point for point in points if (point.metric, point.depth) == (IOU, 0)]
        starts.setdefault((protocol, start.network, start.objects), set()).add(start.successes)
    assert {len(found) for found in starts.values()} == {1}


def test_curves_without_results_are_named():
    results = results_of(FIG2, [*curve_of("e=2"), *curve_of("e=2 transpose")])
    assert [(one.curve.name, one.protocol) for one in results if one.points] == [
        ("e=2", "PAPER"),
        ("e=2 transpose", "PAPER"),
    ]
    assert not_run(results) == [
        "not run yet in protocol PAPER: e=2 r=8, e=2 no lookahead",
        "not run yet in protocol CORRECTED: e=2, e=2 r=8, e=2 transpose, e=2 no lookahead",
    ]


def test_the_same_search_serves_two_figures():
    epochs = EXPERIMENTS["epochs"]
    results = results_of(epochs, list(curve_of("e=2")))
    assert [one.curve.name for one in results if one.points] == ["e=2"]
    own = list(curve_of("e=2", figure="epochs", depth=2))
    assert results_of(epochs, [*curve_of("e=2"), *own])[0].points == tuple(own)


def test_a_protocol_beyond_the_experiments_own_is_shown():
    results = results_of(EXPERIMENTS["fig3"], list(curve_of("narrow", "CORRECTED", "fig3")))
    assert [one.protocol for one in results] == ["PAPER", "PAPER", "CORRECTED", "CORRECTED"]


def test_the_report_holds_ours_and_the_papers(tmp_path):
    results = results_of(FIG2, list(curve_of()))
    assert conditions(results) == [
        "IoU rate: 90 test images of boxes.h5; search from published, budget standard, seed 0",
        "SIM: 200 grasps of procedural40, 5 pose(s) each; search from published, budget standard, seed 0",
    ]
    picture, markdown, table = write_report(tmp_path, FIG2, results, "Our numbers: made up.")
    assert picture.stat().st_size > 20_000
    with table.open() as stream:
        rows = list(csv.DictReader(stream))
    wanted = {"curve": "e=2", "protocol": "PAPER", "metric": SIM, "depth": "4"}
    (row,) = (row for row in rows if wanted.items() <= row.items())
    assert (row["successes"], row["trials"], row["paper"]) == ("154", "200", "0.835")
    assert float(row["low"]) < 0.77 < float(row["high"])
    assert len(rows) == 4 * 2 * 2 * 6  # the paper's readings stand there for curves that were not run, too
    text = markdown.read_text()
    assert "154/200 = 0.770" in text
    assert "made up" in text
    assert "not run yet in protocol CORRECTED" in text


def test_what_the_search_saw_is_drawn_where_no_rate_is_known(tmp_path):
    seen = [replace(point, objects="boxes.h5") for point in curve_of() if point.metric == SCORE]
    counted = [replace(point, successes=350, trials=500) for point in seen]
    for points, images in ((seen, "the"), (counted, "500")):
        results = results_of(FIG2, points)
        assert [len(results[0].drawn(metric)) for metric in (IOU, SIM)] == [6, 0]
        assert conditions(results) == [
            f"IoU rate: {images} test images that the search selected on, of boxes.h5; "
            "search from published, budget standard, seed 0"
        ]
        _, _, table = write_report(tmp_path, FIG2, results, "")
        with table.open() as stream:
            metrics = {row["metric"] for row in csv.DictReader(stream) if row["value"]}
        assert metrics == {SCORE}
    with_rates = results_of(FIG2, list(curve_of()))[0]
    assert {point.metric for point in with_rates.drawn(IOU)} == {IOU}


def test_names_are_no_formulas(tmp_path):
    points = [replace(point, objects="a_$x_$b") for point in curve_of()]
    picture, _, _ = write_report(tmp_path, FIG2, results_of(FIG2, points), "")
    assert picture.stat().st_size > 10_000


def test_a_report_without_any_results(tmp_path):
    for experiment in EXPERIMENTS.values():
        picture, _, _ = write_report(tmp_path, experiment, results_of(experiment, []), "Nothing yet.")
        assert picture.stat().st_size > 10_000
