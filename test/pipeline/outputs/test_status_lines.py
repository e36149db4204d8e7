"""Every sentence and figure of the status, from a session that stands still: each threshold by itself."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import HERE, Status
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.pipeline.camera_images import NOBODY
from lassokin_ros.pipeline.concerns.catalogue import say
from lassokin_ros.pipeline.concerns.rejections import advice_for
from lassokin_ros.pipeline.depth.depth_images import MATCHED, RECEIVED, UNMATCHED
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson
from lassokin_ros.pipeline.input_checks.placeholders import PLACEHOLDERS
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.people.roster import GONE, Presence
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.output_messages.builders import ERROR, OK, WARN

SECOND = 10**9
SILENT = say("silent", limit=2.0).text


@pytest.fixture
def session():
    """What Diagnostics reads of a session that tracks one person well."""
    view = SimpleNamespace(size=(640, 480))
    tracker = SimpleNamespace(
        config=TrackerConfig(height=1.75),
        skeleton=SimpleNamespace(height=1.75),
        averaged=0.0,
        limitations="",
        learned=SimpleNamespace(size_check=SimpleNamespace(wrong=False, ratio=1.0)),
    )
    only = SimpleNamespace(
        name="",
        key=lambda count: count,
        camera=SimpleNamespace(view=view, warning="", fault="", intrinsics=None),
        depth=None,
        stamps=SimpleNamespace(rate=SimpleNamespace(concern=None), delay_s=None),
        last=(0, ""),
        **dict.fromkeys(("own_depth", "landmark_ids", "image_size"), SimpleNamespace(concern=None)),
    )
    return SimpleNamespace(
        enabled=True,
        first=only,
        counts=Counter(received=100, accepted=100),
        config=NodeSettings(),
        roster=SimpleNamespace(
            status=Status.TRACKING,
            ids=None,
            locked=None,
            trackers={"": tracker},
            calibrations=dict,
            heights=dict,
            evidence_faults={},
        ),
        people=SimpleNamespace(jumped_number=None, numbers_may_be_indices=False),
        tracker=tracker,
        placement=SimpleNamespace(places=None, camera_angles=(0.0, 0.0), camera_height=None),
        scene=SimpleNamespace(image=None, lost_after=0.4, detector_connected=True, untracked_at=lambda stamp_ns: 0),
        cameras={"": only},
        inputs=SimpleNamespace(has_camera=True, nobody_in_view=False, unused_confidence=0.0, camera_fault=""),
    )


@pytest.fixture
def diagnostics(session):
    result = Diagnostics(session, "tracker", 10.0)
    result.count_camera_info(10.0)
    result.count_message([], SECOND, 10.0, 0.001)
    return result


def frame(stamp_ns=SECOND, reprojection_px=2.0, depth=3.5, repeated=0.0, deviation=0.05, held_s=0.0, measured=False):
    state = SimpleNamespace(translation=np.array([0, 0, depth]))
    seen = SimpleNamespace(depth_measured=measured)
    estimate = SimpleNamespace(reprojection_px=reprojection_px, state=state, repeated=repeated, frame=seen)
    estimate.pose = None
    uncertainty = SimpleNamespace(deviation=np.array([0.01, deviation]))
    return FrameResult(
        stamp_ns,
        "optical",
        estimate,
        images=[ImageOfPerson(HERE, SimpleNamespace(focal=1000.0), None, None)],
        skeleton=SimpleNamespace(height=1.75),
        tracker=SimpleNamespace(uncertainty=lambda _: uncertainty),
        held_s=held_s,
    )


def give_depth(session, **settings):
    """Depth images of the only camera."""
    session.first.depth = SimpleNamespace(fault="", frozen=False, check=SimpleNamespace(fault=""))
    session.config = NodeSettings(**settings)


def said(diagnostics, now=11.0, **more):
    line = diagnostics.line(now, **more)
    return line.level, line.message


def test_the_line_of_a_person_who_is_tracked(diagnostics):
    diagnostics.count_message([frame()], SECOND, 10.5, 0.001)
    line = diagnostics.line(11.0)
    assert (line.level, line.name, line.message, line.hardware_id) == (OK, "tracker: person", "tracking", "optical")
    assert Diagnostics(diagnostics._session, "other", 0.0).line(1.0).hardware_id == "none"


def test_what_prevents_tracking_comes_first(session, diagnostics):
    assert said(diagnostics, 12.1) == (WARN, SILENT)
    assert said(diagnostics, 12.1, concern="and more") == (WARN, f"{SILENT}; and more")
    assert said(diagnostics, 12.0) == (OK, "tracking")
    session.first.camera.fault = "K is wrong"
    assert said(diagnostics) == (ERROR, "camera_info refused: K is wrong; the last good one is used")
    session.inputs.has_camera, session.first.camera.view = False, None
    assert said(diagnostics) == (ERROR, "camera_info refused: K is wrong")
    session.first.camera.fault = ""
    assert said(diagnostics) == (WARN, "waiting for camera_info")
    assert said(diagnostics, concern="and more") == (WARN, "waiting for camera_info; and more")
    session.enabled = False
    assert said(diagnostics) == (OK, "disabled by ~/set_enabled")
    session.enabled = session.inputs.has_camera = True
    fresh = Diagnostics(session, "tracker", 0.0)
    assert said(fresh) == (WARN, "waiting for keypoints")


@pytest.mark.parametrize(("seconds", "level"), [(1.0, OK), (1.1, WARN)])
def test_frozen_keypoints(diagnostics, seconds, level):
    diagnostics.count_message([frame(repeated=seconds)], SECOND, 10.5, 0.001)
    assert said(diagnostics)[0] == level
    diagnostics.count_message([frame()], SECOND, 10.5, 0.001)
    assert said(diagnostics) == (OK, "tracking")


def test_the_status_of_a_person(session, diagnostics):
    for status in (Status.LOST, Status.SEARCHING):
        session.roster.status = status
        assert said(diagnostics) == (WARN, "lost")
        assert said(diagnostics, state="nobody") == (OK, NOBODY)
    assert said(diagnostics, presence=Presence(Status.TRACKING), state="nobody") == (OK, "tracking")


def test_a_silent_detector_of_an_empty_room(session, diagnostics):
    session.roster.status, session.config = Status.LOST, NodeSettings(silent_when_empty=True)
    assert said(diagnostics, 12.1) == (WARN, "lost")
    line = diagnostics.line(13.1, state="nobody")
    assert (line.level, line.message, line.values["state"]) == (OK, NOBODY, "nobody")
    session.scene.detector_connected = False
    assert said(diagnostics, 14.1) == (WARN, SILENT)
    fresh = Diagnostics(session, "tracker", 0.0)
    assert said(fresh) == (WARN, "waiting for keypoints")
    session.scene.detector_connected = True
    assert said(fresh, state="nobody") == (OK, NOBODY)


def test_a_lock_is_the_reason_why_nobody_is_followed(session, diagnostics):
    session.roster.locked = "p2"
    assert said(diagnostics) == (OK, "tracking")
    session.roster.status = Status.LOST
    words = "p2 is locked and not seen: nobody else is followed until ~/lock is called with false"
    assert said(diagnostics) == (WARN, f"lost; {words}")
    session.roster.locked = GONE
    words = "the locked person was forgotten: nobody is followed until ~/lock is called"
    assert said(diagnostics) == (WARN, f"lost; {words}")


def test_nobody_in_view(session, diagnostics):
    session.roster.status = Status.LOST
    session.counts.update({"received": 10, NOBODY: 9})
    assert said(diagnostics) == (WARN, "lost")
    session.counts.update({"received": 10, NOBODY: 10})
    assert said(diagnostics) == (OK, NOBODY)
    assert said(diagnostics) == (OK, NOBODY)  # without a message in the period, as before
    session.roster.status = Status.TRACKING
    assert said(diagnostics) == (OK, "tracking")


def test_concerns_of_the_camera_and_of_others_stand_after_the_state(session, diagnostics):
    session.first.camera.warning = "K hardly fits"
    assert said(diagnostics, concern="busy") == (WARN, "tracking; K hardly fits; busy")


PEOPLE = {"people come": 3, "people left": 3}


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ({"received": 10, OUTSIDE_IMAGE: 5}, ""),
        ({"received": 10, OUTSIDE_IMAGE: 6}, "outside the image of 640 x 480 px"),
        *(
            ({"received": 100, key: count}, f"tracking; messages {key}: " * (count > 2))
            for key in (OVERTAKEN, LOST)
            for count in (2, 3)
        ),
        (PEOPLE, "set person_ids to node"),
        (PEOPLE | {"people come": 2}, ""),
        (PEOPLE | {"people left": 2}, ""),
        (PEOPLE | {"resets": 1}, ""),
    ],
)
def test_counts_of_a_period_from_which_a_warning_is_due(session, diagnostics, counts, words):
    session.counts.update(counts)
    level, message = said(diagnostics)
    assert level == (WARN if words else OK) and words in message and (words or message == "tracking")


@pytest.mark.parametrize(
    "settings", [{"person_ids": "node"}, {"rep155": True, "keypoints_type": "hri_msgs/msg/Skeleton2D"}]
)
def test_people_may_come_and_leave_where_no_number_of_a_message_counts(session, diagnostics, settings):
    session.config = NodeSettings(**settings)
    session.counts.update(PEOPLE)
    assert said(diagnostics) == (OK, "tracking")


@pytest.mark.parametrize(
    ("fact", "words"),
    [
        ({"jumped_number": 7}, "number 7 has moved to another person"),
        ({"numbers_may_be_indices": True}, "0, 1, ..."),
        ({}, "re-identified by position only"),
    ],
)
def test_doubtful_identities_are_a_warning(diagnostics, session, fact, words):
    vars(session.people).update(fact)
    diagnostics.count_message([replace(frame(), guessed=not fact)], SECOND, 10.5, 0.001)
    level, message = said(diagnostics)
    assert level == WARN and words in message


def test_rejected_messages_are_named_once_with_advice_and_without_numbers(session, diagnostics):
    session.counts.update({"received": 10, "rejected: too_small": 2, "rejected: old_stamp": 1})
    reasons = [f"keypoints rejected ({reason}): {advice_for(reason)}" for reason in ("old_stamp", "too_small")]
    assert said(diagnostics) == (WARN, "; ".join(["tracking", *reasons]))
    assert said(diagnostics) == (OK, "tracking")  # of the last period
    session.counts.update({"received": 10, "rejected: too_few_landmarks": 3, NOBODY: 3})
    assert said(diagnostics) == (OK, "tracking")  # nobody was there
    session.counts.update({"received": 10, "rejected: too_few_landmarks": 4, NOBODY: 3, OVERTAKEN: 1})
    message = said(diagnostics)[1]
    assert message.startswith("tracking; keypoints rejected (too_few_landmarks): check") and OVERTAKEN in message


@pytest.mark.parametrize(("pixels", "level"), [(29.0, OK), (31.0, WARN)])
def test_keypoints_that_are_no_bodys(diagnostics, pixels, level):
    """30 px at 3.5 m with a focal length of 1000 px are 0.105 m: 0.06 of the height."""
    for i in range(3):
        diagnostics.count_message([frame(reprojection_px=pixels if i else 500.0)], SECOND, 10.5, 0.001)
    found = said(diagnostics)
    assert found[0] == level
    if level == WARN:
        assert "keypoints are more than 0.10 m off the best body" in found[1] and "`landmarks: coco17`" in found[1]
    assert said(diagnostics) == (OK, "tracking")


def test_depth(session, diagnostics):
    give_depth(session, depth="/depth")
    assert "tracking; no depth images on /depth: tracking without measured depth: check" in said(diagnostics)[1]
    session.counts.update({RECEIVED: 1, MATCHED: 5, UNMATCHED: 5})
    assert said(diagnostics) == (OK, "tracking")
    session.counts.update({RECEIVED: 1, MATCHED: 5, UNMATCHED: 6})
    assert "most keypoint messages had no depth image of their time" in said(diagnostics)[1]
    session.counts.update({RECEIVED: 1, MATCHED: 5, UNMATCHED: 6})
    session.first.depth.fault = "depth is damaged"
    assert said(diagnostics) == (WARN, "tracking; depth is damaged")


@pytest.mark.parametrize("used", [0, 1, 2, 10])
def test_depth_images_without_depth_at_the_person(session, diagnostics, used):
    give_depth(session)
    for i in range(10):
        diagnostics.count_message([frame(measured=i < used)], SECOND, 10.5, 0.001)
    session.counts.update({RECEIVED: 10, MATCHED: 10})
    level, message = said(diagnostics)
    assert (level, "no depth near the person" in message) == ((WARN, True) if used < 2 else (OK, False))
    session.counts.update({RECEIVED: 10})
    assert said(diagnostics) == (OK, "tracking")  # the next period starts anew


def test_the_measured_height_of_people_who_are_there(session, diagnostics):
    height = SimpleNamespace(height=1.6789, deviation=0.0512)
    session.roster.heights = lambda: {"": height}
    values = diagnostics.line(11.0).values
    assert (values["height [m]"], values["height: deviation [m]"]) == ("1.679", "0.051")
    session.roster.ids, session.roster.heights = ["p1"], lambda: {"p1": height, "p2": height}
    session.roster.trackers = dict.fromkeys(("p1", "p2"), session.tracker)
    figures = {key: value for key, value in diagnostics.line(12.0).values.items() if "height" in key}
    assert figures == {"p1 height [m]": "1.679", "p1 height: deviation [m]": "0.051"}


@pytest.mark.parametrize(
    ("behind_s", "level"), [(-2.0, WARN), (-0.5, OK), (0.49, OK), (0.51, WARN), (61, OK), (3599, OK), (3601, WARN)]
)
def test_stamps_of_another_clock_and_late_keypoints(diagnostics, behind_s, level):
    for i in range(3):
        stamp_ns = SECOND if i else 10**5 * SECOND
        diagnostics.count_message([frame(stamp_ns)], SECOND + int(behind_s * SECOND), 10.5, 0.001)
    assert said(diagnostics)[0] == level
    diagnostics.count_message([frame(SECOND)], 0, 10.5, 0.001)  # a simulated clock that has not started
    assert said(diagnostics) == (OK, "tracking")


def test_figures_of_a_period(session, diagnostics):
    diagnostics.line(10.0)
    for i, took_s in enumerate((0.001, 0.002, 0.009)):
        stamp_ns = SECOND - i * 10**8
        frames = [frame(stamp_ns, 2.0 + i, deviation=0.05 + 0.01 * i, held_s=0.1), frame(SECOND, 1.0)]
        diagnostics.count_message(frames, SECOND + 3 * 10**8, 10.5 + i, took_s)
    session.counts.update({"received": 10, "accepted": 6, "duplicated": 2, "unstamped": 3, "resets": 4})
    session.counts.update({"ignored while disabled": 5, OVERTAKEN: 7, LOST: 8, PLACEHOLDERS: 9, "rejected: x": 1})
    session.tracker.averaged = 0.0951
    values = diagnostics.line(14.0).values
    assert values == {
        "state": "tracking",
        "input rate [Hz]": "2.50",
        "output rate [Hz]": "1.50",
        "keypoints age [s]": "1.500",
        "camera_info age [s]": "4.000",
        "keypoints delay median [s]": "0.300",
        "callback time median [ms]": "2.000",
        "callback time maximum [ms]": "9.000",
        "reprojection error [px]": "4.00",
        "largest joint deviation [m]": "0.070",
        "received [messages]": "110",
        "accepted [messages]": "106",
        "duplicated [messages]": "2",
        "unstamped [messages]": "3",
        "ignored while disabled [messages]": "5",
        f"{OVERTAKEN} [messages]": "7",
        f"{LOST} [messages]": "8",
        "resets": "4",
        "locked": "nobody",
        f"{PLACEHOLDERS} [messages]": "9",
        "rejected: x [messages]": "1",
        "skeleton: left/right difference, averaged [%]": "9.5",
    }
    later = diagnostics.line(15.0).values
    assert (later["input rate [Hz]"], later["keypoints delay median [s]"]) == ("0.00", "nan")
    assert later["reprojection error [px]"] == "4.00"
    lost = diagnostics.line(16.0, Presence(Status.LOST)).values
    assert lost["reprojection error [px]"] == lost["largest joint deviation [m]"] == "nan" and lost["state"] == "lost"
    assert Diagnostics(session, "tracker", 0.0).line(1.0).values["keypoints age [s]"] == "never"


def test_figures_of_several_people(session, diagnostics):
    session.roster.ids = ["p1", "p2", "p3"]
    session.counts.update({"people come": 3, "people left": 1, "people beyond max_people": 2})
    session.first.depth = SimpleNamespace(fault="", frozen=False, check=SimpleNamespace(fault=""))
    values = diagnostics.line(11.0, Presence(Status.TRACKING, ["p1"])).values
    assert (values["people"], values["people come"], values["people left"]) == ("p1", "3", "3")
    assert values["people beyond max_people"] == "2" and values[f"{RECEIVED} [messages]"] == "0"
    assert diagnostics.line(12.0, Presence(Status.SEARCHING, [])).values["people"] == "nobody"
    assert diagnostics.line(13.0).values["people"] == "p1, p2, p3"


def test_calibration_of_people_who_are_there(session, diagnostics):
    def known(kept_motion):
        proportions = SimpleNamespace(names=("thigh", "neck"))
        known_now = {"lengths": np.log([1.1, 0.9]), "deviation": np.array([0.02, 0.05]), "kept_motion": kept_motion}
        return SimpleNamespace(frozen=False, proportions=proportions, **known_now)

    session.roster.trackers = dict.fromkeys(("p1", "p2", "p3"), session.tracker)
    session.roster.ids, session.roster.calibrations = (
        ["p1", "p2"],
        lambda: {"p1": known(2.5), "p2": known(0.0), "p3": known(1.0)},
    )
    values = diagnostics.line(11.0).values
    figures = {key: value for key, value in values.items() if "calibration" in key}
    state = "learning" if TrackerConfig(height=1.75).calibrate else "off"
    assert figures == {
        "p1 calibration": state,
        "p1 calibration: motion seen [s]": "2.50",
        "p1 calibration: largest deviation [%]": "5.00",
        "p1 calibration: thigh [%]": "+10.00",
        "p1 calibration: neck [%]": "-10.00",
        "p2 calibration": state,
    }


def test_a_period_above_stale_after_is_a_warning(diagnostics, session):
    for i in range(1, 7):
        diagnostics.count_message([frame()], SECOND, 10.0 + 0.5 * i, 0.001)
    level, message = said(diagnostics, 13.1)
    assert level == WARN and "keypoints come every 0.5 s, and stale_after is 0.4 s" in message
    for i in range(6):
        diagnostics.count_message([frame()], SECOND, 13.2 + 0.1 * i, 0.001)
    assert said(diagnostics, 13.8) == (OK, "tracking")


@pytest.mark.parametrize("stale_after", [0.4, 3.0])
def test_a_period_above_lost_after_is_a_warning_about_it(diagnostics, session, stale_after):
    session.config = replace(session.config, stale_after=stale_after)
    for i in range(1, 7):
        diagnostics.count_message([frame()], SECOND, 10.0 + 1.25 * i, 0.001)
    stale, remedy = ("stale_after is 0.4 s and ", "both") if stale_after == 0.4 else ("", "it")
    expected = f"keypoints come every 1.2 s, and {stale}lost_after is 1 s: people are reported as lost in between: set "
    assert f"{expected}{remedy} to two or three periods" in said(diagnostics, 17.6)[1]
