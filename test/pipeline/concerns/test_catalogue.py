"""The catalogue of concerns: complete, used, and the same sentence wherever a concern is seen."""

import re
import string
from pathlib import Path

import pytest

from lassokin_ros.core.observation import Rejection
from lassokin_ros.pipeline.concerns.catalogue import (
    CONCERNS,
    NOTE,
    PROBLEM,
    Raised,
    Seen,
    say,
    without_numbers,
    words_of,
)
from lassokin_ros.pipeline.concerns.rejections import REASONS, advice_for, reason_text

SOURCES = Path(__file__).resolve().parents[3] / "lassokin_ros"


def test_every_row_is_used_and_every_concern_has_a_row():
    sources = [path for path in SOURCES.rglob("*.py") if path.name != "catalogue.py"]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    assert set(re.findall(r'\bsay\(\s*"(\w+)"', text)) <= set(CONCERNS)
    assert [key for key in CONCERNS if f'"{key}"' not in text] == []


@pytest.mark.parametrize("key", CONCERNS)
def test_a_row_is_one_printable_line_for_somebody(key):
    concern = CONCERNS[key]
    assert concern.seen and concern.text.isprintable() and not concern.text.endswith((".", ":"))
    assert all(name != "" for _, name, _, _ in string.Formatter().parse(concern.text) if name is not None)


def test_a_concern_has_its_subject_before_and_its_advice_behind():
    found = say("frozen", of="camera 'left'", limit=1.0)
    assert found.text.startswith("camera 'left': keypoints are frozen: the same ones for more than 1 s: check that ")
    assert (found.key, found.level, found.seen) == ("frozen", PROBLEM, Seen.DIAGNOSTICS)
    assert say("unseen", level=PROBLEM, limbs="left leg").level == PROBLEM and CONCERNS["unseen"].level == NOTE
    with pytest.raises(KeyError):
        say("frozen")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("late by 1 s", "Late by 1 s."), ("p1: lost", "p1: lost."), ("Done.", "Done."), ("camera 'a'", "Camera 'a'.")],
)
def test_a_sentence_of_the_page(text, sentence):
    assert Raised("remark", NOTE, text).sentence == sentence


def test_who_sees_what():
    found = [say("frozen", limit=1.0), say("unscored"), say("late", seconds=2.0)]
    assert words_of(found, Seen.LOG) == [found[1].text] and len(words_of(found)) == 3


def test_numbers_do_not_make_another_text_and_names_do():
    assert without_numbers("12.5 px, nan m, 1e-9") == without_numbers("3 px, 0.1 m, inf")
    assert without_numbers("camera2") != without_numbers("camera1")


def test_every_rejection_has_a_name_and_a_remedy():
    assert {rejection.value for rejection in Rejection} <= set(REASONS)
    assert all(reason.name and reason.remedy for reason in REASONS.values())
    assert (reason_text("some_other"), advice_for("some_other")) == ("some other", "")
