"""`replay --report FILE`: collect data during the replay and write the page at its end.

The page is one HTML file with its data, scripts and plotly.js; it loads nothing from elsewhere.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from lassokin_ros.common.atomic_files import AtomicFiles, refuse_existing
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.concerns.catalogue import DOUBT, PROBLEM, Raised, say
from lassokin_ros.pipeline.image_sets import SAME_INSTANT_NS
from lassokin_ros.pipeline.session import Session
from lassokin_ros.replay.frames import FrameTable
from lassokin_ros.replay.report import tables
from lassokin_ros.replay.report.facts import Facts
from lassokin_ros.replay.report.findings import findings
from lassokin_ros.replay.report.images import ReportImages
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
        **{table.__name__: table(facts) for table in tables.TABLES},
        data=_script_json(page_data(facts)),
        times=_script_json(timing_data(facts)),
        images=_script_json(images),
        plotly=_file(PLOTLY),
        script="\n".join(_file(f"{name}.js") for name in SCRIPTS),
    )


def _subtitle(facts: Facts) -> Iterator[str]:
    first = facts.table.first_stamp_ns
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


class Report:
    """The report of one replay."""

    def __init__(
        self,
        path: Path | None,
        session: Session,
        table: FrameTable,
        replace: bool = False,
        given: Skeleton | None = None,
    ) -> None:
        """Raises ReportError if the page cannot be written to `path`. replace: an existing file may be replaced.

        path: None for `summary_lines` alone, without a page. table: collects the frames of the session.
        given: the skeleton before the first of two passes; None: that of the session.
        """
        if path is not None:
            check_report(path, replace)
        self._path, self._session, self._table = path, session, table
        self._skeleton = given or session.tracker.skeleton  # before calibration
        self.images = {name: ReportImages() for name in table.cameras}
        """The images of each camera, each added with the stamp of its keypoint message."""
        self.remarks: list[str] = []
        """Texts that the page shows as notes."""
        self.findings: list[Raised] = []
        """What the page says, after `write`."""

    @property
    def summary_lines(self) -> list[str]:
        """The problems and doubts as lines for the terminal."""
        return [f"{one.level:<15} {one.sentence}" for one in self.findings if one.level in (PROBLEM, DOUBT)]

    def write(
        self,
        files: AtomicFiles,
        title: str,
        topics: tuple[str, str],
        own_keypoints: bool = False,
        warnings: Sequence[Raised] = (),
    ) -> None:
        """Write the page as part of `files`, if it has a path. For the others see `Facts` and `findings`.

        Raises ReportError, and the error of `files`.
        """
        session, tracker = self._session, self._session.tracker
        views = [camera.camera.view for camera in session.cameras.values()]
        facts = Facts(
            title.encode(errors="backslashreplace").decode(),  # file names may hold bytes that are not UTF-8
            topics,
            self._table,
            dict(session.counts),
            tracker.config,
            session.config,
            self._skeleton,
            tracker.layout.names,
            tuple(view.size if view is not None and min(view.size) > 0 else None for view in views),
            own_keypoints,
            session.placement.level,
        )
        self.findings = [*findings(facts, warnings), *(say("remark", text=text) for text in self.remarks)]
        if self._path is None:
            return
        times = {message.stamp_ns: message.time for message in self._table.messages}
        apart_ns = SAME_INSTANT_NS if len(self.images) > 1 else 0
        photos, *more = (images.data(times, apart_ns) for images in self.images.values())
        files.write_text(self._path, page(facts, self.findings, {**photos, "others": more}))
