"""`replay --report`: the content of the page, and its safety; test_report_page.py tests the drawing."""

import ast
import html
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from browser import held, unpacked  # noqa: E402
from recordings import (  # noqa: E402  # noqa: E402
    CLOUD,
    INFO,
    START_NS,
    clouds,
    read,
    synthetic_pixels,
    webcam_info,
    write_messages,
    write_recording,
)

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.common.atomic_files import AtomicFiles  # noqa: E402
from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.observation import Rejection  # noqa: E402
from lassokin_ros.doubt.pose_events import FailureModel  # noqa: E402
from lassokin_ros.pipeline.concerns.rejections import REASONS  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from lassokin_ros.replay.bags import typestore  # noqa: E402
from lassokin_ros.replay.frames import FrameTable  # noqa: E402
from lassokin_ros.replay.playback import NodeMessages, Playback  # noqa: E402
from lassokin_ros.replay.report import page_json as data  # noqa: E402
from lassokin_ros.replay.report.report import PLOTLY, Report, ReportError  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
FRAMES, FEW = 75, 36
PERIOD_NS = 1_000_000_000 // 30
HEIGHT = "-p", "height:=1.75"


def report(bag, *options):
    """The page of a recording of a person of given height, as text."""
    path, output = bag.parent / f"{bag.name}.html", bag.parent / f"{bag.name}_out"
    assert main([str(bag), "--output", str(output), "--report", str(path), *HEIGHT, *options]) == 0
    return path.read_text(encoding="utf-8")


def said(page):
    """[(level, sentence)] of the findings, as plain text."""
    found = re.search(r'<ul id="findings">(.*?)</ul>', page, re.DOTALL).group(1)
    return [(level, re.sub(r"<.*?>", "", text)) for level, text in re.findall(r'<li class="(\w+)">(.*?)</li>', found)]


def figure(page, name):
    """One line of the table of figures."""
    return re.search(rf"<td>{name}</td><td>(.*?)</td>", page).group(1)


def messages(late=0, uncalibrated=False, frames=FRAMES, **how):
    """Messages with keypoints, see `clouds`. late: number of messages before the first camera_info. uncalibrated: one
    without K precedes all.
    """
    seen = list(clouds(frames, "lens", **how))
    info = webcam_info(frame_id="lens")
    info.k = np.zeros(9)
    before = [("/camera_info", INFO, seen[0][2], info)] if uncalibrated else []
    return [*before, *seen[:late], ("/camera_info", INFO, seen[late][2], webcam_info(frame_id="lens")), *seen[late:]]


def concluded(**how):
    """[(level, sentence)] of the findings about such messages, and the table of frames."""
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    playback, table = Playback(session, NodeMessages(session, typestore(), lambda *_: None)), FrameTable(session)
    playback.listeners.append(table.add)
    for topic, _, time_ns, message in messages(**how):
        (playback.keypoints if topic == "/keypoints" else playback.camera_info)(message, time_ns)
    playback.finish()
    report = Report(None, session, table)
    topics = ("/keypoints", "/camera_info")
    report.write(AtomicFiles(False, ReportError), "walk", topics, warnings=playback.warnings.found)
    return [(one.level, one.sentence.replace("`", "")) for one in report.findings], table


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    bag = write_recording(tmp_path_factory.mktemp("report") / "clean", FRAMES)
    return bag, report(bag)


def test_a_clean_recording_has_no_warnings(clean):
    _, page = clean
    good, doubt = said(page)
    assert good == ("good", "100.0% of the frames were tracked, and nothing suggests a wrong pose.")
    stated = re.match(r"The joints are off by about (\d+) mm relative to the pelvis, mostly in depth", doubt[1])
    assert doubt[0] == "note" and 60 < int(stated.group(1)) < 120
    assert figure(page, "Keypoint messages") == f"{FRAMES} in 2.5 s, 30.0 Hz"
    assert figure(page, "With a skeleton") == f"{FRAMES} (100.0%)" and figure(page, "Initialised") == "once"
    assert figure(page, "Lost spans") == figure(page, "Short gaps") == "none"
    assert float(figure(page, "Reprojection error").split()[0]) < 5
    assert float(re.search(r"([\d.e-]+) largest", figure(page, "Duality gap, relative")).group(1)) < 1e-9
    assert float(figure(page, "Latency p50").split()[0]) > 0.05


def test_the_page_contains_the_published_values(clean):
    bag, page = clean
    (person,) = held(page)["people"]
    joints = read(bag.parent / "clean_out", "/tracker/joints")
    published = np.array([[[p.position.x, p.position.y, p.position.z] for p in m.poses] for _, m in joints])
    assert np.abs(unpacked(person["positions"]) - published).max() < 0.00051  # m
    states = read(bag.parent / "clean_out", "/tracker/joint_states")
    angles = np.degrees([m.position[3:] for _, m in states]).reshape(len(states), -1, 3)
    assert np.abs(unpacked(person["angles"]) - angles).max() < 0.051  # deg
    _, pixels, confidence = synthetic_pixels(FRAMES)
    seen = np.where(confidence[..., None] > 0, pixels, np.nan)
    assert np.nanmax(np.abs(unpacked(person["detected"]) - seen)) < 0.051  # px
    assert np.array_equal(np.isnan(unpacked(person["detected"])), np.isnan(seen))
    certificates = [
        {v.key: v.value for v in m.status[0].values} for _, m in read(bag.parent / "clean_out", "/tracker/certificate")
    ]
    series = person["series"]
    assert np.allclose(
        series["reprojection"]["value"], [float(c["reprojection error [px]"]) for c in certificates], rtol=1e-3
    )
    assert series["support"]["value"] == [float(c["support size"]) for c in certificates]
    assert np.allclose(series["reprojection"]["time"], np.arange(FRAMES) / 30, atol=1e-3)
    outline, model = unpacked(person["outline"]), held(page)
    landmark = model["landmarks"].index("left_knee")  # COCO's knee is the joint's centre
    assert (
        np.abs(unpacked(person["reprojected"])[:, landmark] - outline[:, model["joints"].index("left_knee")]).max()
        < 0.11
    )


def test_the_page_is_reproducible_except_for_times(clean, tmp_path):
    bag, page = clean
    again = tmp_path / "again.html"
    assert main([str(bag), "--output", str(tmp_path / "out"), "--report", str(again), *HEIGHT]) == 0

    def lasting(text):
        return re.sub(r'(<div id="timing">.*?</div>|id="times">.*?</script>)', "", text, flags=re.DOTALL)

    other = again.read_text(encoding="utf-8")
    assert lasting(other) == lasting(page) and len(page) - len(lasting(page)) > 500


def test_images_without_people_count_as_such_with_several_people(tmp_path):
    page = report(write_messages(tmp_path / "bag", messages(spoil=absent(20, 60))), "-p", "max_people:=2")
    assert figure(page, "Keypoint messages").startswith(f"{FRAMES} in")
    without = int(figure(page, "Without a skeleton"))
    assert 40 <= without <= 44  # people who appear are no people yet
    assert figure(page, "With a skeleton").split()[0] == str(FRAMES - without)
    assert figure(page, "People").endswith(f"{FRAMES - without} skeletons in total")


def test_the_summary_lists_the_problems_and_doubts_of_the_page(tmp_path, capsys):
    """The doubts have spans for the slider and the plots; an export marks their frames."""

    def spoil(stamps, pixels, confidence):
        exchanged(stamps, pixels, confidence)
        confidence[2:20] = 0

    bag = write_messages(tmp_path / "bag", messages(spoil=spoil))
    page = report(bag, "--export", str(tmp_path / "motion.npz"))
    expected = [(level, html.unescape(text)) for level, text in said(page) if level in ("problem", "doubt")]
    lines = [line.replace("`", "") for line in capsys.readouterr().out.splitlines()]
    assert not any(line.startswith("warned") for line in lines)  # the page has them
    found = [line.partition(" ") for line in lines if line.startswith(("problem ", "doubt "))]
    assert [(level, text.strip()) for level, _, text in found] == expected
    assert {level for level, _ in expected} == {"problem", "doubt"}
    (person,) = held(page)["people"]
    spans = [(start, end) for start, end, why in person["wrong"] if "the detector exchanges left and right" in why]
    assert spans and all(any(start <= time <= end for start, end in spans) for time in (1.0, 2.0))
    times = np.array(person["time"])[[why is None for why in person["refused"]]]
    marks = np.any([(times >= start - 0.002) & (times <= end + 0.002) for start, end, _ in person["wrong"]], axis=0)
    with np.load(tmp_path / "motion.npz") as motion:
        assert np.array_equal(motion["likely_wrong"], marks) and 10 < marks.sum() < len(times)


def absent(*spans):
    def spoil(stamps, pixels, confidence):
        for first, last in zip(spans[::2], spans[1::2]):
            confidence[first:last] = 0

    return spoil


def shifted(first, seconds, last=None):
    def spoil(stamps, pixels, confidence):
        stamps[first:last] += int(seconds * 1e9)

    return spoil


def noisy(stamps, pixels, confidence):
    pixels += np.random.default_rng(0).normal(size=pixels.shape) * 14


def swapped(stamps, pixels, confidence):
    pixels[:, [9, 15]] = pixels[:, [15, 9]]


def upside_down(stamps, pixels, confidence):
    pixels[..., 1] = 720 - pixels[..., 1]


def legs_below_the_image(stamps, pixels, confidence):
    pixels[:, 13:17, 1] += 400


def without_legs(stamps, pixels, confidence):
    confidence[:, 13:17] = 0


def exchanged(stamps, pixels, confidence):
    other = np.array([0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15])
    pixels[30:60], confidence[30:60] = pixels[30:60][:, other], confidence[30:60][:, other]


def another_person(stamps, pixels, confidence):
    pixels[40:] += (260, 30)


def slow_and_repeated(stamps, pixels, confidence):
    stamps += (stamps - stamps[0]) * 4
    for values in (pixels, confidence):
        values[1::2] = values[: len(values[1::2]) * 2 : 2]


CASES = {
    "lost": (
        {"spoil": absent(10, 16, 20, 60)},
        "problem 46 frames rejected: too few landmarks: check that a person is in the image",
        "problem Nobody was tracked from 0.6 to 2.0 s (1.4 s): 40 x too few landmarks.",
        "note The person was re-initialised once, at 2.0 s; the skeleton may jump there.",
        "note 1 short gap, 0.2 s in total, the longest 0.2 s; tracking continued",
    ),
    "silence": (
        {"spoil": shifted(20, 2.0)},
        "problem Nobody was tracked from 0.6 to 2.7 s (2.0 s): no keypoint messages.",
    ),
    "no camera": (
        {"late": 10, "uncalibrated": True, "frames": FEW},
        "problem 10 frames rejected: no camera_info received: camera_info must come before the keypoints; record it",
    ),
    "loop": (
        {"spoil": shifted(40, -1.2)},
        "problem The stamps are not monotonic: at 1.3 s they jump back by 1.2 s (a looped bag, or a second clock?);",
    ),
    "out of order": (
        {"spoil": shifted(40, -0.2)},
        "problem 6 frames rejected: stamp not newer than the previous one: check that the detector copies",
    ),
    "one stamp": ({"spoil": shifted(40, 3600, 41)}, "note 1 frame rejected: stamp jump: a single jump is"),
    "noisy": (
        {"spoil": noisy, "frames": FEW},
        r"problem The median reprojection error is \d\d.\d px, with noise_px 3: check noise_px, camera_info",
    ),
    "swapped": ({"spoil": swapped, "frames": FEW}, "problem Landmarks far from their reprojection: "),
    "upside down": (
        {"spoil": upside_down, "frames": FEW},
        "problem The body has pointed down in the image in most images: check",
    ),
    "larger image": (
        {"spoil": lambda stamps, pixels, _: pixels.__imul__(3), "frames": FEW},
        f"problem Keypoints lie outside the image of 1280 x 720 px of camera_info in {FEW} of {FEW}",
    ),
    "partly outside": (
        {"spoil": legs_below_the_image, "frames": FEW},
        "note In 100% of the images the person is partly outside of the image.",
    ),
    "slow": (
        {"times": lambda stamps: stamps, "spoil": slow_and_repeated, "frames": FEW},
        "note The keypoint rate is 6.0 Hz: ",
        f"note {FEW // 2} of {FEW} messages repeat the previous keypoints",
    ),
    "another person": (
        {"spoil": another_person},
        r"doubt The pose is likely wrong from 1.1 to \d.\d s: the detector continues with another person",
    ),
    "late": (
        {"times": lambda stamps: stamps + 2_500_000_000},
        "problem Keypoints are 2.5 s old when they arrive: the detector queues images or is too slow; let it",
    ),
    "no stamps": (
        {"spoil": lambda stamps, *_: stamps.__imul__(0)},
        f"problem Keypoints without a stamp: outputs carry the time of their arrival ({FRAMES} messages): let",
    ),
}


@pytest.mark.parametrize("case", sorted(CASES))
def test_errors_are_reported(case):
    how, *expected = CASES[case]
    sentences, table = concluded(**how)
    print(sentences)
    for start in expected:
        pattern = re.escape(start).replace(r"\\d", r"\d")
        assert any(re.match(pattern, f"{level} {text}") for level, text in sentences), start
    assert not any(level == "good" for level, _ in sentences) or expected[0].startswith("note")
    times = table.columns("")["time"].tolist()
    assert times == sorted(times)  # one wrong stamp does not stretch the axis
    assert max(message.time for message in table.messages) <= 12.6


def test_the_good_line_names_what_it_does_not_judge(monkeypatch):
    found, _ = concluded(spoil=without_legs, frames=FEW)
    (good,) = [text for level, text in found if level == "good"]
    assert good.endswith("nothing suggests a wrong pose. The left leg and right leg cannot be judged: hardly seen.")
    assert any("Not seen: left leg (seen in 0% of the frames), right leg (seen in 0%" in text for _, text in found)
    monkeypatch.setattr(FailureModel, "update", lambda self, stamp, *figures: 0.3 if stamp < 0.39 else 0.01)
    (level, good), *notes = concluded()[0]
    outside = "100.0% of the frames were tracked, and outside of the marked spans nothing suggests a wrong pose."
    assert (level, good) == ("good", outside)
    assert any(text.startswith("In 16% of the frames an error above 100 mm is likely") for _, text in notes), notes


def test_the_floor_is_under_the_feet(clean):
    (person,) = held(clean[1])["people"]
    names, places = held(clean[1])["joints"], unpacked(person["positions"])
    lowest = -places[:, [names.index("left_foot"), names.index("right_foot")], 1].max(axis=1)
    assert -0.12 < person["floor"] - np.median(lowest) < 0.02


def test_every_reason_has_a_description():
    keys = {rejection.value for rejection in Rejection}
    for file in [*(ROOT / "msg_adapters").rglob("*.py"), *(ROOT / "lassokin_ros/pipeline").rglob("*.py")]:
        code = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(code)) if "AdapterError(" in code else ():
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "AdapterError":
                keys |= {n.value for n in [node.args[0]] if isinstance(n, ast.Constant)}
    assert len(keys) > 15 and keys <= set(REASONS), keys - set(REASONS)
    assert all(words and advice for words, advice in REASONS.values())


def test_nothing_is_fetched_and_all_names_are_escaped(tmp_path):
    """Names come from recordings and files. Whatever characters they contain, they stay text."""
    evil = "</script><script>document.body.dataset.error='x'</script>"
    layout = (ROOT / "lassokin_ros/core/body/layouts/coco17.yaml").read_text(encoding="utf-8")
    (tmp_path / "own.yaml").write_text(layout.replace("name: left_ear,", f'name: "{evil}",'), encoding="utf-8")
    bag = write_recording(tmp_path / "a <b onclick=x>&'\"`", 5)
    page = report(bag, "-p", f"landmarks:={tmp_path / 'own.yaml'}", "--keypoints-topic", "/keypoints")
    frame = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)  # without the scripts themselves
    assert "<script>document" not in page and "<b onclick" not in page
    assert evil in held(page)["landmarks"] and "&lt;b onclick=x&gt;" in frame
    assert not re.search(r"(src|href)\s*=|@import|url\(", frame) and "default-src 'none'" in frame


def test_a_long_recording_is_thinned_with_a_note(clean, tmp_path, monkeypatch):
    bag, _ = clean
    monkeypatch.setattr(data, "BUDGET", 20_000)
    monkeypatch.setattr(data, "POINTS", 20)
    assert main([str(bag), "--output", str(tmp_path / "out"), "--report", str(tmp_path / "page.html"), *HEIGHT]) == 0
    model = held((tmp_path / "page.html").read_text(encoding="utf-8"))
    (person,) = model["people"]
    assert person["stride"] == 3 and len(person["time"]) == FRAMES // 3
    assert unpacked(person["positions"]).nbytes // 4 <= 20_000
    assert len(person["series"]["reprojection"]["time"]) == 19
    full = held(clean[1])["people"][0]["series"]["reprojection"]["value"]
    assert max(person["series"]["reprojection"]["value"]) == max(full)  # peaks are kept
    assert [len(data.worst(np.zeros(count), np.zeros(count))[0]) for count in (20, 21, 39)] == [20, 11, 20]


def test_the_page_of_a_minute_is_small():
    """A minute of one person at 30 Hz, by the sizes of the parts."""
    plotly = ROOT / "lassokin_ros" / "replay" / "report" / PLOTLY
    joints, landmarks = 24, 33
    skeletons = 1800 * 2 * (joints * 11 + landmarks * 4)
    assert min(skeletons, data.BUDGET) * 4 / 3 + plotly.stat().st_size < 4_000_000


def test_packed_arrays_are_read_back():
    values = np.array([[0.0, 1.2344], [np.nan, -31.0]])
    packed = data.packed(values, 0.001)
    back = unpacked(packed)
    assert packed["step"] == 0.001 and np.isnan(back[1, 0]) and np.nanmax(np.abs(back - values)) < 0.00051
    large = data.packed(np.array([1e9, -5.0, np.inf]), 0.1, farthest=64_000)
    assert large["step"] == 2.0 and unpacked(large)[0] == 64_000 and np.isnan(unpacked(large)[2])
    assert unpacked(data.packed(np.zeros((0, 24, 3)), 1.0)).shape == (0, 24, 3)


BAD = {
    "there already": (["--report", "there.html"], "'there.html' exists already; choose another name or add --force"),
    "a folder": (["--report", "."], "'.' is a folder; expected the name of a file"),
    "no folder": (["--report", "nix/page.html"], "there is no folder 'nix' for 'page.html'"),
    "an archive": (["second", "--report", "page.html"], "--report 'page.html' names one file for many recordings"),
}


@pytest.mark.parametrize("case", sorted(BAD))
def test_an_unwritable_report_is_one_line(case, tmp_path, monkeypatch, capsys):
    arguments, expected = BAD[case]
    monkeypatch.chdir(tmp_path)
    write_recording(tmp_path / "bag", 2)
    write_recording(tmp_path / "second", 2)
    (tmp_path / "there.html").write_text("mine")
    before = sorted(tmp_path.iterdir())
    assert main(["bag", *arguments, "--output", "out"]) == 2
    assert capsys.readouterr().err.startswith(f"lassokin replay: {expected}")
    assert sorted(tmp_path.iterdir()) == before and (tmp_path / "there.html").read_text() == "mine"
    if case == "there already":
        assert main(["bag", *arguments, "--output", "out", "--force"]) == 0
        assert (tmp_path / "there.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_unreadable_messages_are_reported(tmp_path):
    camera = ("/camera_info", INFO, START_NS, webcam_info())
    broken = [("/keypoints", CLOUD, START_NS + i * PERIOD_NS, b"\0\1\0\0abc") for i in range(4)]
    page = report(write_messages(tmp_path / "bag", [camera, *broken]))
    assert ("problem", "Nothing was tracked: none of 4 messages produced a skeleton.") in said(page)
    assert any(text.startswith("4 frames rejected: malformed message") for _, text in said(page))
    assert '<td>malformed message</td><td class="n">4</td>' in page.partition("Rejections by reason")[2]
