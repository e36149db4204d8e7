"""The page's tables of figures, as HTML; everything that comes from a recording or a file is escaped."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import fields
from html import escape
from typing import Any

import numpy as np

from lassokin_ros.replay.report.facts import Facts, landmark_errors
from lassokin_ros.replay.report.rejection_advice import advice_for, words_for

MOST_ROWS = 40
"""Rows of a table that could be as long as the recording."""


def marked(text: str) -> str:
    """Escaped, with `names` between backticks set as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table with a title, nothing without rows; numbers: the columns that are set flush right."""
    lines = []
    for row in rows:
        cells = [
            f'<td class="n">{marked(c)}</td>' if i in numbers else f"<td>{marked(c)}</td>" for i, c in enumerate(row)
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    if not lines:
        return ""
    cells = [f'<th class="n">{escape(c)}</th>' if i in numbers else f"<th>{escape(c)}</th>" for i, c in enumerate(head)]
    top = f"<thead><tr>{''.join(cells)}</tr></thead>" if any(head) else ""
    return f"<section><h3>{escape(title)}</h3><table>{top}<tbody>{''.join(lines)}</tbody></table></section>"


def figures(facts: Facts) -> str:
    """What the replay came to."""
    counts, tracks = facts.counts, facts.tracks
    received, accepted = counts.get("received", 0), counts.get("accepted", 0)
    spans = [span for person in facts.people for span in facts.spans[person]]
    lost = [span.seconds for span in spans if span.lost]
    short = [span.seconds for span in spans if not span.lost]
    rows = [
        ("Keypoint messages", f"{received} in {facts.duration:.1f} s, {facts.rate:.1f} Hz"),
        ("Gave a skeleton", f"{accepted}" + (f" ({accepted / received:.1%})" if received else "")),
        ("Refused", f"{received - accepted}"),
    ]
    if facts.node.several_people:
        rows.append(("People", f"{len(facts.people)} followed, {len(tracks)} skeletons in all"))
    if tracks:
        pixels = np.array([row.reprojection_px for row in tracks])
        gap, kkt = np.array([row.relative_gap for row in tracks]), np.array([row.kkt for row in tracks])
        support = np.array([row.support for row in tracks])
        depth = np.array([row.positions[0, 2] for row in tracks if row.positions is not None])
        rows += [
            ("Reprojection error", f"{_percentile(pixels, 50):.2f} px median, {_percentile(pixels, 99):.2f} px p99"),
            ("Duality gap, relative", f"{_percentile(gap, 50):.1e} median, {gap.max():.1e} largest"),
            ("KKT residual, of alpha", f"{_percentile(kkt, 50):.1e} median, {kkt.max():.1e} largest"),
            (
                "Degrees of freedom that move",
                f"{_percentile(support, 50):.0f} median, {support.max():.0f} largest, of "
                f"{3 * facts.skeleton.joint_count}",
            ),
            (
                "Distance of the pelvis",
                f"{_percentile(depth, 50):.2f} m median, {depth.min():.2f} to {depth.max():.2f} m",
            ),
            ("Initialised", "once" if facts.initialisations == 1 else f"{facts.initialisations} times"),
        ]
    rows += [
        ("Lost spans", f"{len(lost)}, {sum(lost):.1f} s in all" if lost else "none"),
        ("Short gaps", f"{len(short)}, {sum(short):.1f} s in all" if short else "none"),
        ("Calibration", calibration(facts)),
    ]
    return table("Figures", ("", ""), rows)


def calibration(facts: Facts) -> str:
    """In one line: whether lengths are learned, and by how much they changed."""
    if not facts.tracker.calibrate:
        return f"off; the bones are those of '{facts.skeleton.name}' at {facts.skeleton.height:g} m"
    changes = [abs(change) for person in facts.people for _, _, change in bones(facts, person)]
    if not changes or max(changes) < 1e-4:
        return "on; the images do not contradict the given bones, which stayed"
    return f"on; bones changed by up to {max(changes):.1%}"


def bones(facts: Facts, person: str) -> list[tuple[str, float, float]]:
    """(joint, mm at the end, share by which it changed) of every bone, named by the joint in which it ends."""
    lengths = [row.lengths for row in facts.accepted(person) if row.lengths is not None]
    if not lengths:
        return []
    given = np.linalg.norm(facts.skeleton.offsets, axis=-1)
    return [
        (name, 1e3 * float(end), float(end / start - 1))
        for name, start, end in zip(facts.skeleton.joint_names, given, lengths[-1])
        if start > 1e-6
    ]


def timing(facts: Facts) -> str:
    """What another run of the same would give otherwise."""
    times = np.array([1e3 * m.seconds for m in facts.log.messages if np.isfinite(m.seconds)])
    if not len(times):
        return ""
    rows = [
        ("Latency p50", f"{_percentile(times, 50):.2f} ms"),
        ("Latency p99", f"{_percentile(times, 99):.2f} ms"),
        ("Largest", f"{times.max():.2f} ms"),
        ("The whole recording", f"{times.sum() / 1e3:.1f} s, {len(times) / max(times.sum() / 1e3, 1e-9):.0f} frames/s"),
    ]
    return table("Speed, on the machine of this run", ("", ""), rows)


def rejections(facts: Facts) -> str:
    """By reason, with advice."""
    rows = []
    for key, count in facts.rejected.items():
        reason, _, of_person = key.partition(" (")
        rows.append((words_for(reason) + (f" ({of_person}" if of_person else ""), str(count), advice_for(reason)))
    return table("Refused, by reason", ("reason", "messages", "what to look at"), rows, (1,))


def lost_spans(facts: Facts) -> str:
    """When nobody was tracked, or one of several was not."""
    rows = []
    for person in facts.people:
        for span in facts.spans[person]:
            kind = "lost, found anew" if span.lost else "short gap"
            why = ", ".join(f"{n} x {words_for(key)}" for key, n in sorted(span.reasons.items()))
            rows.append((person, f"{span.start:.2f}", f"{span.end:.2f}", f"{span.seconds:.2f}", kind, why))
    if not facts.node.several_people:
        rows = [("the person", *row[1:]) for row in rows]
    more = [("...", f"{len(rows) - MOST_ROWS} more", "", "", "", "")] if len(rows) > MOST_ROWS else []
    head = ("who", "from s", "to s", "length s", "", "messages in it")
    return table("Without a skeleton", head, rows[:MOST_ROWS] + more, (1, 2, 3))


def landmarks(facts: Facts) -> str:
    """Each landmark's share of frames and distance."""
    error, seen = landmark_errors(facts.tracks, len(facts.landmarks))
    if not facts.tracks:
        return ""
    rows = [
        (name, f"{share:.0%}", f"{pixels:.1f}" if np.isfinite(pixels) else "-")
        for name, share, pixels in zip(facts.landmarks, seen, error)
    ]
    return table("Landmarks", ("", "seen", "error px, median"), rows, (1, 2))


def bone_lengths(facts: Facts) -> str:
    """Of the person, or of each of several, at the end."""
    rows = [
        (
            f"{person}: {name}" if person else name,
            f"{length:.0f}",
            f"{change:+.1%}" if abs(change) > 5e-5 else "as given",
        )
        for person in facts.people
        for name, length, change in bones(facts, person)
    ]
    return table("Bones at the end", ("to joint", "mm", "change"), rows, (1, 2))


def settings(facts: Facts) -> str:
    """Every parameter with its value; those that are not the default are marked."""
    rows = []
    for config in (facts.tracker, facts.node):
        for item in fields(config):
            value = getattr(config, item.name)
            changed = "" if value == item.default else f"default {_plain(item.default)}"
            rows.append((item.name, f"{_plain(value)} {item.metadata['unit']}".strip(), changed))
    return table("Parameters", ("", "", ""), rows)


def _plain(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def _percentile(values: np.ndarray, percentile: float) -> float:
    return float(np.percentile(values, percentile))
