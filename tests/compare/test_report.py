"""The report file: whole, self-contained, honest when it thins curves."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from server.compare.colours import inks
from server.compare.decimate import kept
from server.compare.report import Band, Column, Panel, Report, Series
from server.view3d.palette import LANE_RGB

VOID = {"meta", "input", "path", "use", "rect", "line", "br"}
T_S = np.arange(0.0, 300.0, 0.01)


class Outline(HTMLParser):
    """Checks that what is opened is closed, and collects texts and ids."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.texts = [], [], []

    def handle_starttag(self, tag, attrs):
        self.ids += [value for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def outline(html):
    parser = Outline()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    return parser


def report():
    made = Report("Lanes <side by side>").heading("Part & one").text("a < b", "second")
    made.table(["lane", Column(name="RMS", unit="m", digits=3)], [["ins_ekf", 1.23456], ["vqf", None]], title="Table")
    band = Band(x=T_S, low=-np.ones_like(T_S), high=np.ones_like(T_S))
    series = [Series(name="ins_ekf", x=T_S, y=np.sin(T_S)), Series(name="mean NIS", x=T_S, y=np.cos(T_S))]
    made.plot(series, "time, s", "error, m", title="Errors", bands=[band])
    return made.panels([Panel(series=series[:1], x_label="time, s", y_label="roll, °")] * 3, columns=3)


def test_the_file_parses_and_asks_the_network_for_nothing():
    html = report().html()
    found = outline(html)
    assert not re.findall(r"(?:https?:)?//[a-z]|@import|url\((?!#)|src=|<link", html)
    text = " ".join(found.texts)
    for wanted in ("Lanes <side by side>", "a < b", "1.235", "time, s", "roll, °", "mean NIS", "–"):
        assert wanted in text


def test_references_inside_a_drawing_lead_somewhere_and_headings_are_unique():
    html = report().html()
    ids = outline(html).ids
    assert set(re.findall(r'href="#([^"]+)"', html)) <= set(ids)
    assert set(re.findall(r"url\(#([^)]+)\)", html)) <= set(ids)
    assert len([each for each in ids if each.startswith("part-one")]) == 1


def test_no_stand_in_colour_is_left_and_lanes_have_their_own():
    html = report().html()
    drawings = "".join(re.findall(r"<svg.*?</svg>", html, re.DOTALL))
    assert set(re.findall(r"(?<!href=\")#[0-9a-f]{6}\b", drawings)) == set()
    for theme in ("light", "dark"):
        assert "--s-ins-ekf: #{:02x}{:02x}{:02x}".format(*LANE_RGB[theme]["ins_ekf"]) in html
    assert 'data-of="mean-nis"' in html


def test_a_lane_is_drawn_alike_in_every_report_and_no_two_lanes_alike():
    from server.nav.lanes.registry import LANES

    together = inks(LANES)
    assert all(inks([lane])[lane] == together[lane] for lane in LANES)
    assert len({(ink.light, ink.dash) for ink in together.values()}) == len(LANES)


def test_thinning_keeps_every_peak_and_every_hole():
    y = np.sin(T_S)
    y[12_345], y[20_001] = 9.0, -7.0
    y[15_000:15_100] = np.nan
    rows = kept((y,), 600)
    assert len(rows) < 1000
    assert {0, 12_345, 20_001, len(y) - 1} <= set(rows.tolist())
    assert np.isnan(y[rows]).any()
    assert (np.diff(rows) > 0).all()


def test_short_curves_are_drawn_whole():
    assert np.array_equal(kept((T_S[:500],), 600), np.arange(500))


@pytest.mark.parametrize("cell", [None, float("nan"), float("inf")])
def test_unknown_is_a_dash_never_a_number(cell):
    assert Column(name="x").text(cell) == "–"


def test_a_negative_zero_is_shown_as_zero():
    assert Column(name="x", digits=1).text(-0.01) == "0.0"


def test_an_empty_figure_is_left_out():
    empty = [Series(name="a", x=np.empty(0), y=np.empty(0))]
    assert "<figure" not in Report("t").plot(empty, "x", "y").html()
