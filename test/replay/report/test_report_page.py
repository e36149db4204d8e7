"""The report's page in a real browser: it draws, its controls work, and it requests nothing from outside."""

import io

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from browser import Page, browser  # noqa: E402
from messages import crowd  # noqa: E402
from recordings import START_NS, read, synthetic_pixels, webcam_info, write_messages, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM  # noqa: E402
from lassokin_ros.replay.bags import typestore  # noqa: E402
from msg_adapters.backends import RosbagsBackend  # noqa: E402

FRAMES, LOST = 90, (30, 66)
LEFT, RIGHT = (0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)
PLOTS = ("space", "image", "series", "landmarks")
JOINTS = 6  # the trace of the joints in the 3D plot, after the body's meshes


def spoil(stamps, pixels, confidence):
    confidence[slice(*LOST)] = 0


@pytest.fixture(scope="module")
def chromium():
    with browser() as running:
        yield running


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    write_recording(folder / "bag", FRAMES, spoil=spoil)
    assert main([str(folder / "bag"), "--output", str(folder / "out"), "--report", str(folder / "page.html")]) == 0
    return folder


@pytest.fixture(scope="module")
def opened(chromium, report):
    return Page(chromium, report / "page.html")


@pytest.fixture
def page(opened, report):
    """The page, shared by the tests; tests that rotate it open their own."""
    yield opened
    assert opened.errors == [] and opened.requests == [f"file://{report / 'page.html'}"]


def picture(page, selector):
    """(h, w, 3) 0 to 255, the visible pixels of an element."""
    pyplot = pytest.importorskip("matplotlib.image", reason="matplotlib reads the screenshot")
    return np.round(255 * pyplot.imread(io.BytesIO(page.page.locator(selector).screenshot()), "png")[..., :3]).astype(
        int
    )


def where(pixels, colour):
    """(k, 2) row and column of the pixels with about this colour."""
    return np.argwhere(np.abs(pixels - colour).max(axis=-1) < 40)


def shown(page, plot, trace):
    """(points, axes) of a plot's trace."""
    text = f"(() => {{ const t = document.getElementById('{plot}').data[{trace}]; return [t.x, t.y, t.z || []]; }})()"
    columns = [c for c in page.value(text) if c]
    return np.array(columns, dtype=float).T


def go(page, frame):
    page.page.fill("#slider", str(frame))
    page.reach(f"document.body.dataset.frame === '{frame}'", f"frame {frame}")


def test_everything_is_drawn(page):
    assert page.value("document.body.dataset.drawn") == "yes"
    for plot in PLOTS:
        assert page.value(f"document.querySelectorAll('#{plot} .main-svg').length") > 0, plot
        kinds = f"['data', '_fullData'].map((key) => document.getElementById('{plot}')[key].map((t) => t.type))"
        wanted, known = page.value(kinds)  # of a type that it does not know, plotly.js makes a scatter
        assert wanted == known and set(wanted) <= {"scatter", "scatter3d", "mesh3d"}, plot
    lines = "document.querySelectorAll('#series .scatterlayer .trace path.js-line').length"
    basic = page.value(lines)
    assert basic >= 7
    page.page.check("#inner")
    page.reach(f"{lines} > {basic} + 1", "the solver's figures")
    page.page.uncheck("#inner")
    page.reach(f"{lines} === {basic}", "the figures without them")
    page.value("window.scrollTo(0, 0)")  # the box is far down; the controls would cover the next picture
    assert page.value("document.querySelectorAll('#image .scatterlayer .trace').length") == 6
    assert page.value("document.documentElement.scrollWidth <= 1280")  # nothing exceeds the page


def test_the_person_is_upright_and_faces_the_viewer(page):
    pixels = picture(page, "#space")
    left, right = where(pixels, LEFT), where(pixels, RIGHT)
    assert len(left) > 300 and len(right) > 300
    assert left[:, 1].mean() > right[:, 1].mean() + 20  # the left side of a person who faces the camera is on the right
    joints = shown(page, "space", JOINTS)
    names = page.value("document.getElementById('space').data[6].text")
    place = {name: joints[i] for i, name in enumerate(names)}
    assert place["head"][2] > place["pelvis"][2] + 0.4 > place["left_ankle"][2] + 0.8
    scene = page.value(
        "(() => { const s = document.getElementById('space')._fullLayout.scene; return [s.xaxis.range, "
        "s.yaxis.range, s.zaxis.range, [s.aspectratio.x, s.aspectratio.y, s.aspectratio.z]]; })()"
    )
    metres = [high - low for low, high in scene[:3]]
    assert np.ptp(np.divide(scene[3], metres)) < 1e-6  # the axes have equal scales
    assert scene[2][0] <= joints[:, 2].min() + 0.02


def test_the_slider_shows_the_published_skeleton_and_image(page, report):
    published = {round((t - START_NS) * 30e-9): m for t, m in read(report / "out", "/tracker/joints")}
    _, pixels, confidence = synthetic_pixels(FRAMES)
    for frame in (12, 80):
        go(page, frame)
        places = np.array([[p.position.x, p.position.z, -p.position.y] for p in published[frame].poses])
        assert np.abs(shown(page, "space", JOINTS) - places).max() < 0.001
        seen = confidence[frame] > 0
        assert np.abs(shown(page, "image", 4)[seen] - pixels[frame, seen]).max() < 0.06
        body = places[:, [0, 2, 1]] * [1, -1, 1]
        knee = page.value("document.getElementById('image').data[4].text").index("left_knee")
        (expected,) = WEBCAM.lens.distort(body[[4], :2] / body[[4], 2:])
        assert np.abs(shown(page, "image", 5)[knee] - expected).max() < 0.5
        cursor = page.value("document.getElementById('series').layout.shapes[0].x0")
        assert abs(cursor - frame / 30) < 0.001 and f"{frame / 30:.2f} s" in page.page.inner_text("#time")


def test_a_lost_span_is_shaded_and_explained(page):
    go(page, 50)
    assert np.isnan(shown(page, "space", JOINTS)).all()
    assert page.page.inner_text(".absent >> nth=0") == "no skeleton at this time: too few landmarks"
    assert not len(where(picture(page, "#space"), LEFT))
    spans = page.value("document.getElementById('series').layout.shapes.slice(1).map((s) => [s.x0, s.x1])")
    assert np.allclose(spans, [[(LOST[0] - 1) / 30, LOST[1] / 30]], atol=1e-3)
    go(page, 5)
    assert not page.page.is_visible(".absent >> nth=0") and len(where(picture(page, "#space"), LEFT)) > 300


def test_the_page_plays_in_real_time_and_stops(chromium, report):
    """By the clock of the page, which this test advances: a slow browser makes no difference."""
    page = Page(chromium, report / "page.html", clock=True)

    def play_for(milliseconds, first, last):
        page.page.clock.run_for(milliseconds)
        shown = "Number(document.body.dataset.frame)"  # when it is drawn
        page.reach(f"{shown} >= {first} && {shown} <= {last}", f"frame {first} to {last}")

    go(page, 70)
    page.page.click("#play")
    assert "Pause" in page.page.inner_text("#play")
    play_for(300, 78, 80)  # of 30 Hz
    play_for(1000, 89, 89)
    assert "Play" in page.page.inner_text("#play")
    page.page.select_option("#speed", "0.25")
    page.page.click("#play")  # from the beginning
    play_for(800, 5, 7)
    page.page.click("#play")
    assert "Play" in page.page.inner_text("#play") and page.errors == []
    page.page.close()


def test_views_rotate_and_are_dragged_and_angles_are_selected(chromium, report):
    page = Page(chromium, report / "page.html")
    eye = (
        "(() => { const e = document.getElementById('space')._fullLayout.scene.camera.eye; return [e.x, e.y, e.z]; })()"
    )
    before = page.value(eye)
    page.page.check("#turn")
    page.reach(f"Math.abs({eye}[0] - {before[0]}) > 0.1", "another side")
    page.page.uncheck("#turn")
    after = page.value(eye)
    assert np.isclose(np.hypot(*after[:2]), np.hypot(*before[:2])) and after[2] == before[2]
    page.page.check("#follow")
    assert np.abs(shown(page, "space", JOINTS)[0, :2]).max() < 1e-6  # the pelvis
    page.page.select_option("#view", "image")
    low, high = page.value("document.getElementById('image')._fullLayout.xaxis.range")
    assert low <= 0 and high >= WEBCAM.size[0]
    page.page.select_option("#joint", "left_knee")
    names = page.value("document.getElementById('series').data.slice(0, 3).map((t) => t.name)")
    assert names == ["left_knee_x", "left_knee_y", "left_knee_z"]
    box = page.page.locator("#space").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    turned = f"Math.abs({eye}[1] - {after[1]}) > 0.1"
    for _ in range(10):  # a busy machine may draw the scene after the mouse was moved
        page.page.mouse.move(x, y)
        page.page.mouse.down()
        page.page.mouse.move(x + 90, y - 40, steps=5)
        page.page.mouse.up()
        if page.comes(turned, 3_000):
            break
    assert page.value(turned)
    up = "document.getElementById('space')._fullLayout.scene.camera.up"
    assert page.value(up) == {"x": 0, "y": 0, "z": 1}  # the horizon is kept
    floor = page.value("document.getElementById('space').data.filter((t) => t.type === 'mesh3d').at(-1).opacity")
    assert 0.3 < floor < 0.8 and page.errors == []  # it hides nobody
    page.page.close()


def test_several_people_can_be_selected(chromium, tmp_path):
    stamps, pixels, confidence = synthetic_pixels(30)
    backend = RosbagsBackend(typestore())
    messages = [("/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, webcam_info())]
    for stamp, xy, scores in zip(stamps.tolist(), pixels, confidence):
        people = [(xy + [shift, 0], scores) for shift in (-300, 300)]
        cloud = crowd(backend, stamp, people, [4, 7], "camera_optical_frame")
        messages.append(("/keypoints", "sensor_msgs/msg/PointCloud2", stamp, cloud))
    bag = write_messages(tmp_path / "bag", messages)
    arguments = ["--output", str(tmp_path / "out"), "--report", str(tmp_path / "page.html"), "-p", "max_people:=2"]
    assert main([str(bag), *arguments]) == 0
    page = Page(chromium, tmp_path / "page.html", "#person=p7&t=0.5")
    assert page.page.inner_text("#person").split() == ["p4", "p7"]
    assert page.page.input_value("#person") == "1" and page.value("document.body.dataset.frame") == "15"
    first = shown(page, "image", 4)
    page.page.select_option("#person", "0")
    page.reach("document.getElementById('image').data[4].x.some((x) => x !== null && x < 500)", "the other person")
    assert np.allclose(np.nanmedian(shown(page, "image", 4) - first, axis=0), [-600, 0], atol=0.2)
    assert page.errors == []
    page.page.close()


def test_doubtful_spans_are_coloured_and_explained(chromium, tmp_path):
    def exchanged(stamps, pixels, confidence):
        other = np.array([0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15])
        pixels[30:60] = pixels[30:60][:, other]

    bag = write_recording(tmp_path / "bag", FRAMES, spoil=exchanged)
    assert main([str(bag), "--output", str(tmp_path / "out"), "--report", str(tmp_path / "page.html")]) == 0
    page = Page(chromium, tmp_path / "page.html", "#t=1.0")
    assert page.value("document.querySelectorAll('#findings .good').length") == 0
    assert page.page.inner_text(".doubtful >> nth=0").startswith("likely wrong: the detector exchanges left and right")
    mark = page.page.locator("#marks .wrong").first.bounding_box()
    thumb = page.page.locator("#slider").bounding_box()
    assert mark["x"] - 8 <= thumb["x"] + thumb["width"] * 30 / FRAMES <= mark["x"] + mark["width"] + 8
    shapes = page.value(
        "document.getElementById('series').layout.shapes.slice(1).map((s) => [s.x0, s.x1, s.fillcolor])"
    )
    assert any(start <= 1.0 <= end and "230,159,0" in colour for start, end, colour in shapes)
    go(page, 5)
    assert not page.page.is_visible(".doubtful >> nth=0") and page.errors == []
    page.page.close()


def test_limbs_without_keypoints_are_faint_and_bars_show_the_error_of_each_landmark(chromium, tmp_path):
    def without_legs(stamps, pixels, confidence):
        confidence[:, 13:17] = 0

    bag = write_recording(tmp_path / "bag", 10, spoil=without_legs)
    assert main([str(bag), "--output", str(tmp_path / "out"), "--report", str(tmp_path / "page.html")]) == 0
    page = Page(chromium, tmp_path / "page.html")
    meshes = page.value("document.getElementById('space').data.slice(0, 6).map((t) => [t.x.length, t.opacity])")
    (left, solid), (faint_left, faint) = meshes[0], meshes[3]
    assert faint < 0.5 < solid and left > 0  # the arm
    assert faint_left == left  # thigh, shank and foot; upper arm, forearm and hand
    errors = page.value("JSON.parse(document.getElementById('data').textContent).people[0].landmarks.error")
    assert errors[13:] == [None] * 4 and None not in errors[:13]
    colours = picture(page, "#landmarks .nsewdrag")
    row = len(colours) / len(errors)
    most = page.value("document.getElementById('landmarks')._fullLayout.xaxis.range")[1]
    for i, error in enumerate(errors):
        line = colours[round((i + 0.25) * row)]  # below the edge of the bar, above the text
        long = max(len(where(line[None], colour)) for colour in (LEFT, RIGHT, (0x4D,) * 3))
        assert abs(long - (error or 0) / most * colours.shape[1]) < 4, i
    box = page.page.locator("#landmarks .nsewdrag").bounding_box()
    label = "document.querySelector('#landmarks .hovertext')?.textContent"
    for i, seen in ((12, f"right_hip: {errors[12]:.1f} px, seen in 100 %"), (14, None), (3, "left_ear: ")):
        page.page.mouse.move(box["x"] + 40, box["y"] + box["height"] * (i + 0.4) / len(errors), steps=4)
        wanted = f"{label}?.startsWith('{seen}')" if seen else f"!{label}"
        assert page.comes(wanted, 20_000), (i, page.value(label))
    assert not page.page.is_visible("#landmarks .axistext") and page.errors == []
    page.page.close()


def test_the_page_fits_a_phone_and_an_audit_of_accessibility_finds_nothing(chromium, report):
    """axe, whose rules are those of Lighthouse's category. The details are open, so that all of the page is seen."""
    audit = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python has the rules")
    page = Page(chromium, report / "page.html")
    page.value("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    fits = "[...document.querySelectorAll('section, .pair > div')].every((one) => one.scrollWidth <= one.clientWidth)"
    for width in (1280, 390):
        page.page.set_viewport_size({"width": width, "height": 800})
        page.reach(f"document.documentElement.scrollWidth <= {width}", f"a page of {width} px")
        page.reach(fits, "plots that have followed the page's width")
        found = audit.Axe().run(page.page).response
        assert [(rule["id"], rule["nodes"][0]["html"]) for rule in found["violations"]] == []
        assert len(found["passes"]) > 20
    page.page.close()


def test_a_recording_without_a_person_is_shown(chromium, tmp_path):
    def nobody(stamps, pixels, confidence):
        confidence[:] = 0

    bag = write_recording(tmp_path / "bag", 8, spoil=nobody)
    assert main([str(bag), "--output", str(tmp_path / "out"), "--report", str(tmp_path / "page.html")]) == 0
    page = Page(chromium, tmp_path / "page.html")
    assert page.errors == [] and page.value("document.body.dataset.error") is None
    assert "Nothing was tracked" in page.page.inner_text("#findings")
    page.page.close()
