"""Assemble the page: one HTML file with its data, scripts and plotly.js; it loads nothing from elsewhere."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from lassokin_ros.common.atomic_files import refuse_existing
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.concerns.catalogue import Raised
from lassokin_ros.replay.report import tables
from lassokin_ros.replay.report.facts import Facts
from lassokin_ros.replay.report.page_json import page_data, timing_data

SCRIPTS = ("common", "body", "space", "image", "series", "page")
"""The scripts are concatenated in this order, into one function."""

PLOTLY = "plotly-gl3d.min.js"
"""The part of plotly.js that has scatter, scatter3d and mesh3d, as npm has it; see CONTRIBUTING.md."""

FIRST_DATE_NS = 946_684_800_000_000_000
"""ns: the year 2000. Earlier stamps are no dates: those of a simulation or of a video begin with zero."""


class ReportError(LassokinError):
    """The report cannot be created or written."""


def check_report(path: Path, replace: bool = False) -> None:
    """Raise ReportError if a report cannot be created at `path`. Call it before the replay starts."""
    refuse_existing(path, replace, ReportError)


def page(facts: Facts, findings: Sequence[Raised], images: dict[str, Any]) -> str:
    """Return the HTML text.

    findings: in their order on the page. images: see `ReportImages.data`.
    """
    template = Template(_file("page.html"))
    return template.substitute(
        title=escape(facts.title),
        subtitle=escape(" · ".join(_subtitle(facts))),
        style=_file("page.css"),
        findings="".join(f'<li class="{f.level}">{tables.marked(f.sentence)}</li>' for f in findings),
        figures=tables.figures(facts),
        solver=tables.solver(facts),
        timing=tables.timing(facts),
        rejections=tables.rejections(facts),
        lost=tables.lost_spans(facts),
        landmarks=tables.landmarks(facts),
        bones=tables.bone_lengths(facts),
        settings=tables.settings(facts),
        data=_script_json(page_data(facts)),
        times=_script_json(timing_data(facts)),
        images=_script_json(images),
        plotly=_file(PLOTLY),
        script="\n".join(_file(f"{name}.js") for name in SCRIPTS),
    )


def _subtitle(facts: Facts) -> Iterator[str]:
    first = facts.log.first_stamp_ns
    if first and first >= FIRST_DATE_NS:
        yield datetime.fromtimestamp(first // 1_000_000_000, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    yield f"{facts.duration:.1f} s"
    yield f"keypoints {facts.topics[0]} ({facts.tracker.landmarks})"
    yield f"camera {facts.topics[1]}" + (
        f", {facts.image_size[0]} x {facts.image_size[1]} px" if facts.image_size else ""
    )
    yield f"height {facts.tracker.height_text}"


def _script_json(data: dict[str, Any]) -> str:
    """Return JSON that cannot end the enclosing script element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _file(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
