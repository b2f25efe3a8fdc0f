"""The live view, in a terminal and line by line."""

from __future__ import annotations

import io

import pytest
from journals import MadeUpNetworks, by_hand, failed, key_of, scored, start
from rich.console import Console

from ggcnn_net2net.search.history import read_history
from ggcnn_net2net.search.live import LiveView, trainings_left
from ggcnn_net2net.search.settings import SearchSettings


class WithLevels(MadeUpNetworks):
    """Tells also about every level that begins."""

    level = 0

    def scores(self, nodes):
        if nodes[0] and not nodes[0][-1].startswith("retrain") and nodes != [self.committing]:
            self.level += 1
            event = {
                "event": "level",
                "lookahead": len(self.lookaheads),
                "level": self.level,
                "levels": self.settings.depth - len(self.lookaheads),
                "known": sum(node in self.known for node in nodes),
                "candidates": [{"candidate": key_of(n), "parent": key_of(n[:-1]), "operation": n[-1]} for n in nodes],
            }
            self.events.append(event)
        return super().scores(nodes)

    committing = None

    def commit(self, node):
        self.level, self.committing = 0, node
        try:
            return super().commit(node)
        finally:
            self.committing = None


def plain(events, **settings):
    stream = io.StringIO()
    with LiveView(Console(file=stream, width=40), **settings) as view:
        for event in events:
            view.on_event(event)
    return stream.getvalue()


def level_by_hand(number, level, levels, known, *children):
    pairs = [{"candidate": key, "parent": parent, "operation": operation} for key, parent, operation in children]
    return {
        "event": "level", "lookahead": number, "level": level, "levels": levels, "known": known, "candidates": pairs,
    }  # fmt: skip


def by_hand_with_levels():
    first = level_by_hand(0, 1, 2, 0, ("a", "root", "deeper(1)"), ("b", "root", "wider(1)"))
    grandchildren = [
        ("ad", "a", "deeper(1)"),
        ("aw", "a", "wider(1)"),
        ("bd", "b", "deeper(1)"),
        ("bw", "b", "wider(1)"),
    ]
    events = by_hand()
    events.insert(10, level_by_hand(1, 1, 1, 2, *grandchildren[2:]))
    events.insert(4, level_by_hand(0, 2, 2, 0, *grandchildren))
    events.insert(2, first)
    return events


def test_lines_without_a_terminal():
    text = plain(by_hand_with_levels())
    assert "\x1b" not in text
    assert text.splitlines()[:12] == [
        "start: IoU rate 0.500, 1,000 parameters",
        "lookahead 1 of 2, level 1 of 2: 2 candidates, 0 known",
        "  0.700  deeper(1) (1,100 parameters, 2 epochs, 10 s)",
        "  0.600  wider(1) (1,200 parameters, 2 epochs, 10 s)",
        "lookahead 1 of 2, level 2 of 2: 4 candidates, 0 known",
        "  0.550  deeper(1), deeper(1) (1,300 parameters, 2 epochs, 10 s)",
        "  failed  deeper(1), wider(1) (2 epochs, 5 s): the loss is not finite",
        "  0.800  wider(1), deeper(1) (1,250 parameters, 2 epochs, 10 s)",
        "  0.300  wider(1), wider(1) (1,900 parameters, 2 epochs, 10 s)",
        "committed to wider(1): IoU rate 0.600",
        "lookahead 2 of 2, level 1 of 1: 2 candidates, 2 known",
        "committed to wider(1), deeper(1): IoU rate 0.800",
    ]
    assert text.splitlines()[12:] == ["finished"]  # the counts follow in the command's summary


def test_of_what_was_done_before_an_interruption_only_the_number_is_printed():
    events = by_hand()[:6]
    resumed = by_hand_with_levels()[2]
    lines = plain([*events, {**resumed, "known": 2}, by_hand()[6]]).splitlines()
    assert lines == [
        "start: IoU rate 0.500, 1,000 parameters",
        "resumed with 4 candidates",
        "lookahead 1 of 2, level 1 of 2: 2 candidates, 2 known",
        "  0.800  wider(1), deeper(1) (1,250 parameters, 2 epochs, 10 s)",
    ]


def test_replicates_are_told_apart():
    events = [start(SearchSettings(replicates=2)), scored("root", None, "root", 0.5)]
    events.append(level_by_hand(0, 1, 5, 0, ("a", "root", "deeper(1)")))
    events += [scored("a", "root", "deeper(1)", 0.6), failed("a", "root", "deeper(1)", replicate=1)]
    assert plain(events).splitlines()[-2:] == [
        "  0.600  deeper(1) (1,000 parameters, 2 epochs, 10 s, replicate 1 of 2)",
        "  failed  deeper(1) (2 epochs, 5 s, replicate 2 of 2): the loss is not finite",
    ]


@pytest.mark.parametrize("terminal", [True, False])
def test_unknown_events_do_no_harm_anywhere(terminal):
    coffee = {"event": "coffee"}
    with LiveView(Console(file=io.StringIO(), force_terminal=terminal)) as view:
        view.on_event(coffee)
        for event in by_hand_with_levels():
            view.on_event(event)
            view.on_event(coffee)
            view.render()


def shown(view):
    console = Console(file=io.StringIO(), record=True, width=120)
    console.print(view.render())
    return console.export_text()


def terminal_view(**settings):
    return LiveView(Console(file=io.StringIO(), force_terminal=True, width=120), **settings)


def test_the_view_of_the_terminal():
    view = terminal_view(workers=2)
    events = by_hand_with_levels()
    assert "Scoring the network to start from" in shown(view)
    for event in events[:7]:  # one of the four of the second level is scored
        view.on_event(event)
    text = shown(view)
    rows = [line.split() for line in text.splitlines()]
    assert "lookahead 1 of 2, level 2 of 2" in text
    assert "1/4 candidates, 0 were known" in text
    assert ["deeper(1)", "0.700", "1,100"] in rows
    assert ["wider(1)", "0.600", "1,200"] in rows
    assert "Best on the path: root, IoU rate 0.500" in text
    assert "Best of all: deeper(1), IoU rate 0.700, 1,100 parameters" in text
    assert "3 candidates trained, 0 failed" in text
    assert "left: at most 0:00:15" in text  # 3 here, none later: 3 x 10 s for 2 workers
    for event in events[7:]:
        view.on_event(event)
    assert "left" not in shown(view)
    assert "2 were met again" in shown(view)


def test_a_cluster_that_has_no_workers_yet():
    view = terminal_view(workers=0)
    for event in by_hand_with_levels()[:7]:
        view.on_event(event)
    assert "left: at most 0:00:30" in shown(view)


def test_it_draws_itself_in_a_terminal():
    stream = io.StringIO()
    with LiveView(Console(file=stream, force_terminal=True, width=120)) as view:
        for event in by_hand_with_levels()[:8]:
            view.on_event(event)
    assert "lookahead 1 of 2, level 2 of 2" in stream.getvalue()
    assert "\x1b[" in stream.getvalue()


@pytest.mark.parametrize(
    "settings", [{}, {"retrain": 8}, {"lookahead": False}, {"width": 1}, {"width": 5, "depth": 3}], ids=str
)
@pytest.mark.parametrize("failing", [0.0, 0.1])
def test_the_trainings_left_are_never_fewer_than_it_says(settings, failing):
    events = WithLevels(SearchSettings(**settings), failing).run()
    trained = [event["event"] in ("scored", "failed") for event in events]
    estimates = [
        (trainings_left(read_history(e for e in events[:index] if e["event"] != "level"), event), sum(trained[index:]))
        for index, event in enumerate(events)
        if event["event"] == "level"
    ]
    assert all(estimate >= left for estimate, left in estimates)
    assert estimates[0][0] < 3 * estimates[0][1]
    assert len(estimates) >= 3
