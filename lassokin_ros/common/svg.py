"""Plots as SVG: axes with ticks, lines, dots and areas.

matplotlib is not used, because it would take an eighth of the size of the demo's environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

GRID, FRAME = "#e4e4e4", "#555555"
STEPS = (1, 2, 2.5, 5, 10)


@dataclass
class Axes:
    """A plot. corner, size: of its rectangle, px. x, y: the values at its left and right, bottom and top edges."""

    corner: tuple[float, float]
    size: tuple[float, float]
    x: tuple[float, float]
    y: tuple[float, float]
    inside: list[str] = field(default_factory=list)
    around: list[str] = field(default_factory=list)

    def line(self, points: np.ndarray, colour: str, width: float) -> None:
        """Draw a line through points (n, 2)."""
        self.inside.append(
            f'<polyline points="{self._places(points)}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
            'stroke-linecap="round" stroke-linejoin="round"/>'
        )

    def dots(self, points: np.ndarray, colour: str, radius: float) -> None:
        """Draw dots at points (n, 2)."""
        for x, y in self._pixels(points):
            self.inside.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{colour}" stroke="white"/>')

    def area(self, points: np.ndarray, colour: str) -> None:
        """Fill the area between a line through points (n, 2) and y = 0."""
        closed = np.vstack([[points[0, 0], 0], points, [points[-1, 0], 0]])
        self.inside.append(f'<polygon points="{self._places(closed)}" fill="{colour}"/>')

    def grid(self, x_labels: bool = True, y_labels: bool = True, most: int = 5) -> None:
        """Draw lines and numbers at round values. most: number of lines on each axis."""
        (width, height), lines = self.size, []
        for value in ticks(self.x, most):
            at = self._pixels(np.array([[value, self.y[0]]]))[0][0]
            lines.append(f'<path d="M{at:.1f} 0V{height:g}" stroke="{GRID}"/>')
            if x_labels:
                self._text((at, height + 14), f"{value:g}", "middle")
        for value in ticks(self.y, most):
            at = self._pixels(np.array([[self.x[0], value]]))[0][1]
            lines.append(f'<path d="M0 {at:.1f}H{width:g}" stroke="{GRID}"/>')
            if y_labels:
                self._text((-5, at + 4), f"{value:g}", "end")
        self.inside[:0] = lines

    def label(self, title: str = "", x: str = "", y: str = "") -> None:
        """Write a title above, and names of the axes below and at the left."""
        width, height = self.size
        self._text((width / 2, -8), title, "middle", 15)
        self._text((width / 2, height + 30), x, "middle")
        lines = y.split("\n")
        for number, line in enumerate(lines):
            place = (-38 - 15 * (len(lines) - 1 - number), height / 2)
            self._text(place, line, "middle", 13, f' transform="rotate(-90 {place[0]:g} {place[1]:g})"')

    def svg(self) -> str:
        """Return the element."""
        (left, top), (width, height) = self.corner, self.size
        inner = "".join(self.inside)
        return (
            f'<g transform="translate({left:g} {top:g})"><svg width="{width:g}" height="{height:g}">{inner}</svg>'
            f'<rect width="{width:g}" height="{height:g}" fill="none" stroke="{FRAME}"/>{"".join(self.around)}</g>'
        )

    def _text(self, place: tuple[float, float], words: str, anchor: str, size: int = 12, more: str = "") -> None:
        if words:
            self.around.append(text(place, words, anchor, size, more))

    def _pixels(self, points: np.ndarray) -> np.ndarray:
        """Return points (n, 2) in px of the rectangle, y down."""
        low, high = np.array([self.x[0], self.y[0]]), np.array([self.x[1], self.y[1]])
        share = (np.asarray(points) - low) / (high - low)
        share[:, 1] = 1 - share[:, 1]
        pixels: np.ndarray = share * self.size
        return pixels

    def _places(self, points: np.ndarray) -> str:
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in self._pixels(points))


def ticks(limits: tuple[float, float], most: int) -> list[float]:
    """Return round values between two limits, which may be in either order; `most` or fewer."""
    low, high = min(limits), max(limits)
    power = 10.0 ** np.floor(np.log10((high - low) / most))
    step = next(power * factor for factor in STEPS if (high - low) / (power * factor) <= most)
    return [round(float(n * step), 9) for n in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def text(place: tuple[float, float], words: str, anchor: str = "start", size: int = 12, more: str = "") -> str:
    """Return a line of text. anchor: start, middle or end. more: further attributes."""
    x, y = place
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" fill="#222"{more}>'
        f"{escape(words)}</text>"
    )


def document(size: tuple[int, int], parts: Sequence[str]) -> str:
    """Return a file of the size (width, height) px with the given elements on white."""
    width, height = size
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'font-family="sans-serif"><rect width="{width}" height="{height}" fill="white"/>\n'
        + "\n".join(parts)
        + "</svg>\n"
    )
