"""The tables of the page, as HTML. All text from recordings and files is escaped."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from html import escape
from typing import Any

import numpy as np

from lassokin_ros.pipeline.concerns.rejections import advice_for, reason_text
from lassokin_ros.replay.report.facts import Facts, bone_changes, landmark_errors

MOST_ROWS = 40
"""Maximum number of rows of the table of gaps."""


def marked(text: str) -> str:
    """Escape a text and set `names` between backticks as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """Return a table with a title, or nothing if there are no rows. numbers: columns that are right-aligned."""

    def line(tag: str, cells: Sequence[str], text: Callable[[str], str]) -> str:
        kinds = (' class="n"' if i in numbers else "" for i in range(len(cells)))
        return f"<tr>{''.join(f'<{tag}{kind}>{text(cell)}</{tag}>' for kind, cell in zip(kinds, cells))}</tr>"

    body = "".join(line("td", row, marked) for row in rows)
    if not body:
        return ""
    top = f"<thead>{line('th', head, escape)}</thead>" if any(head) else ""
    whole = f"<table>{top}<tbody>{body}</tbody></table>"
    return f'<section tabindex="0"><h3>{escape(title)}</h3>{whole}</section>'  # the keyboard scrolls it on a phone


def figures(facts: Facts) -> str:
    """Return the table of result figures."""
    received, tracked = facts.received, facts.tracked
    spans = [span for person in facts.people for span in facts.spans[person]]
    lost = [span.seconds for span in spans if span.lost]
    short = [span.seconds for span in spans if not span.lost]
    inputs = "Images" if facts.own_keypoints else "Keypoint messages"
    inputs = inputs if len(facts.sizes) == 1 else f"Instants of {len(facts.sizes)} cameras"
    rows = [
        (inputs, f"{received} in {facts.duration:.1f} s, {facts.rate:.1f} Hz"),
        ("With a skeleton", f"{tracked}" + (f" ({tracked / received:.1%})" if received else "")),
        ("Without a skeleton", f"{received - tracked}"),
    ]
    if facts.node.several_people:
        rows.append(("People", f"{len(facts.people)} tracked, {facts.skeletons} skeletons in total"))
    if facts.skeletons:
        pixels, depth, times = facts.of("reprojection_px"), facts.of("depth"), int(facts.of("initialised").sum())
        rows += [
            ("Reprojection error", f"{np.median(pixels):.2f} px median, {np.percentile(pixels, 99):.2f} px p99"),
            ("Distance of the pelvis", f"{np.median(depth):.2f} m median, {depth.min():.2f} to {depth.max():.2f} m"),
            ("Initialised", "once" if times == 1 else f"{times} times"),
        ]
    rows += [
        ("Lost spans", f"{len(lost)}, {sum(lost):.1f} s in total" if lost else "none"),
        ("Short gaps", f"{len(short)}, {sum(short):.1f} s in total" if short else "none"),
        ("Calibration", calibration(facts)),
    ]
    return table("Figures", ("", ""), rows)


def solver(facts: Facts) -> str:
    """Return the table of the lasso's figures."""
    if not facts.skeletons:
        return ""
    gap, kkt, support = (facts.of(name) for name in ("relative_duality_gap", "kkt", "support_size"))
    of = 3 * facts.skeleton.joint_count
    rows = [
        ("Duality gap, relative", f"{np.median(gap):.1e} median, {gap.max():.1e} largest"),
        ("KKT residual, of alpha", f"{np.median(kkt):.1e} median, {kkt.max():.1e} largest"),
        ("Moving degrees of freedom", f"{np.median(support):.0f} median, {support.max():.0f} largest, of {of}"),
    ]
    return table("Solver", ("", ""), rows)


def calibration(facts: Facts) -> str:
    """Return the state of calibration in one line."""
    if not facts.tracker.calibrate:
        return f"off; bone lengths of '{facts.skeleton.name}' at {facts.skeleton.height:g} m"
    changes = [abs(change) for *_, change in bone_changes(facts, facts.people)]
    if not changes or max(changes) < 1e-4:
        return "on; bone lengths unchanged"
    return f"on; bone lengths changed by up to {max(changes):.1%}"


def timing(facts: Facts) -> str:
    """Return the table of tracking times, which are not repeatable."""
    times = np.array([1e3 * m.seconds for m in facts.table.messages if np.isfinite(m.seconds)])
    if not len(times):
        return ""
    rows = [
        ("Latency p50", f"{np.median(times):.2f} ms"),
        ("Latency p99", f"{np.percentile(times, 99):.2f} ms"),
        ("Largest", f"{times.max():.2f} ms"),
        ("The whole recording", f"{times.sum() / 1e3:.1f} s, {len(times) / max(times.sum() / 1e3, 1e-9):.0f} frames/s"),
    ]
    return table("Speed, on the machine of this run", ("", ""), rows)


def rejections(facts: Facts) -> str:
    """Return the table of rejections by reason, with advice."""
    rows = []
    for key, count in facts.rejected.items():
        reason, _, of_person = key.partition(" (")
        rows.append((reason_text(reason) + (f" ({of_person}" if of_person else ""), str(count), advice_for(reason)))
    return table("Rejections by reason", ("reason", "messages", "advice"), rows, (1,))


def lost_spans(facts: Facts) -> str:
    """Return the table of spans in which a person was not tracked."""
    rows = []
    for person in facts.people:
        for span in facts.spans[person]:
            kind = "lost" if span.lost else "short gap"
            why = ", ".join(f"{n} x {reason_text(key)}" for key, n in sorted(span.reasons.items()))
            rows.append((person, f"{span.start:.2f}", f"{span.end:.2f}", f"{span.seconds:.2f}", kind, why))
    if not facts.node.several_people:
        rows = [("the person", *row[1:]) for row in rows]
    more = [("...", f"{len(rows) - MOST_ROWS} more", "", "", "", "")] if len(rows) > MOST_ROWS else []
    head = ("person", "from [s]", "to [s]", "length [s]", "kind", "messages")
    return table("Gaps", head, rows[:MOST_ROWS] + more, (1, 2, 3))


def landmarks(facts: Facts) -> str:
    """Return the table of landmarks: share of frames and reprojection error."""
    if not facts.skeletons:
        return ""
    error, seen = landmark_errors(facts)
    rows = [
        (name, f"{share:.0%}", f"{pixels:.1f}" if np.isfinite(pixels) else "-")
        for name, share, pixels in zip(facts.landmarks, seen, error)
    ]
    return table("Landmarks", ("landmark", "seen", "median error [px]"), rows, (1, 2))


def bone_lengths(facts: Facts) -> str:
    """Return the table of bone lengths at the end."""
    rows = [
        (
            ": ".join(filter(None, (person, name))),
            f"{length:.0f}",
            f"{change:+.1%}" if abs(change) > 5e-5 else "unchanged",
        )
        for person, name, length, change in bone_changes(facts, facts.people)
    ]
    return table("Bone lengths at the end", ("to joint", "[mm]", "change"), rows, (1, 2))


def settings(facts: Facts) -> str:
    """Return the table of parameters: value, and default where it differs."""
    rows = []
    for config in (facts.tracker, facts.node):
        for item in fields(config):
            value = getattr(config, item.name)
            changed = "" if value == item.default else f"default {_plain(item.default)}"
            rows.append((item.name, f"{_plain(value)} {item.metadata['unit']}".strip(), changed))
    return table("Parameters", ("", "", ""), rows)


def _plain(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


TABLES = (figures, solver, timing, rejections, lost_spans, landmarks, bone_lengths, settings)
"""The tables of the page; page.html has their places under the names of the functions."""
