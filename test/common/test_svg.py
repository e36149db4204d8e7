"""Plots as SVG: where values are drawn."""

from xml.etree import ElementTree

import numpy as np
import pytest

from lassokin_ros.common.svg import Axes, document, text, ticks

SVG = "{http://www.w3.org/2000/svg}"


def drawn(axes):
    return ElementTree.fromstring(document((300, 200), [axes.svg()]))


def test_values_are_drawn_at_their_places_with_y_upwards():
    axes = Axes((10, 20), (100, 50), (0.0, 10.0), (-1.0, 1.0))
    axes.line(np.array([[0.0, -1.0], [5.0, 0.0], [10.0, 1.0]]), "#000", 1)
    axes.dots(np.array([[2.5, 0.5]]), "#111", 3)
    axes.area(np.array([[0.0, 1.0], [10.0, 1.0]]), "#222")
    picture = drawn(axes)
    assert picture.find(f"{SVG}g").get("transform") == "translate(10 20)"
    assert picture.find(f".//{SVG}polyline").get("points") == "0.0,50.0 50.0,25.0 100.0,0.0"
    dot = picture.find(f".//{SVG}circle")
    assert (dot.get("cx"), dot.get("cy")) == ("25.0", "12.5")
    assert picture.find(f".//{SVG}polygon").get("points") == "0.0,25.0 0.0,0.0 100.0,0.0 100.0,25.0"


def test_axes_that_run_backwards_have_the_same_numbers():
    axes = Axes((0, 0), (100, 100), (0.0, 4.0), (400.0, 100.0))  # rows of an image
    axes.grid()
    places = {element.text: float(element.get("y")) for element in drawn(axes).iter(f"{SVG}text")}
    assert places["100"] == pytest.approx(4) and places["400"] == pytest.approx(104)


@pytest.mark.parametrize(
    "limits, most, expected",
    [((0, 18), 5, [0, 5, 10, 15]), ((-0.8, 0.8), 5, [-0.5, 0, 0.5]), ((0.0, 200.0), 4, [0, 50, 100, 150, 200])],
)
def test_ticks_are_round_values(limits, most, expected):
    assert ticks(limits, most) == expected == ticks(limits[::-1], most)


def test_text_is_escaped():
    assert "a &lt; b &amp; c" in text((0, 0), "a < b & c")
