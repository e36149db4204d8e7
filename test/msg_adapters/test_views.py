"""Views of RViz and Foxglove: messages at the positions of the image, and views in which a person is upright."""

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml
from messages import rosbags_backend
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import WEBCAM, Detector, detections, exact_pixels, motion
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.outputs.urdf import joint_names
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import OPTICAL_FRAME, NodeSettings
from msg_adapters.backends import RclpyBackend
from msg_adapters.inputs import camera_info, point_cloud
from msg_adapters.output_messages.markers import DETECTED, REPROJECTED, ImageMarkerBuilder

cv2 = pytest.importorskip("cv2", reason="OpenCV is the independent projection")

CONFIG = Path(__file__).resolve().parents[2] / "config"
FRAMES, START_NS, FRAME = 20, 10**12, OPTICAL_FRAME
BACKENDS = [rosbags_backend(), *([RclpyBackend()] if find_spec("rclpy") else [])]
DISPLAYS = {
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/Marker": "visualization_msgs/msg/Marker",
    "rviz_default_plugins/PoseArray": "geometry_msgs/msg/PoseArray",
    "rviz_default_plugins/RobotModel": "std_msgs/msg/String",
}
"""Message types that RViz' displays read; Camera reads the image, which is not an output."""
OURS = {t.name.replace("~", "tracker"): t for t in (*topics.PERSON_OUTPUTS, *topics.OTHER_OUTPUTS)}


def full(name):
    """A topic's name with the node's default name for `~`."""
    return name.replace("~", "tracker")


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load((CONFIG / "lassokin.rviz").read_text(encoding="utf-8"))["Visualization Manager"]


@pytest.fixture(scope="module")
def foxglove():
    return json.loads((CONFIG / "foxglove_layout.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module", params=BACKENDS, ids=lambda b: type(b).__name__)
def shown(request):
    """(camera_info, pixels (l, 2), {topic: message}) of a tracked person, seen through a webcam with distortion."""
    session, backend = Session(TrackerConfig(height=1.75, calibrate=False), NodeSettings()), rosbags_backend()
    info = camera_info(backend, START_NS, FRAME, WEBCAM.K, WEBCAM.D, WEBCAM.size)
    session.set_camera(info)
    exact = exact_pixels(session.tracker.kinematics, motion(session.tracker.skeleton, np.arange(FRAMES) / 30))
    pixels, confidence = detections(exact, 30, detector=Detector(noise_px=0.5, outliers=0, gaps_per_second=0))
    confidence[-1, 3] = 0  # an ear is missing
    for i in range(FRAMES):
        frame = session.process(point_cloud(backend, START_NS + i * 33_333_333, FRAME, pixels[i], confidence[i]), 0)
    messages = dict(FrameMessages(request.param, session.tracker.skeleton).build(frame))
    return info, np.where(confidence[-1][:, None] > 0, pixels[-1], np.nan), messages


def in_image(info, points):
    """(k, 2) px: OpenCV's projection of points (k, 3) m in the camera's optical frame, with camera_info's K and D."""
    K = np.asarray(info.k, dtype=float).reshape(3, 3)
    return cv2.projectPoints(np.array(points, dtype=float), np.zeros(3), np.zeros(3), K, np.array(info.d))[0][:, 0]


def places(points):
    return np.array([[p.x, p.y, p.z] for p in points])


def coloured(marker, colours, wanted, points_each):
    """The points with colours of about this value."""
    same = [np.allclose([c.r, c.g, c.b, c.a], wanted, atol=1e-6) for c in colours]
    return places(marker.points).reshape(len(same), points_each, 3)[np.array(same)]


def test_markers_are_at_the_keypoints(shown):
    """The markers' spheres, projected as in a viewer, are within a few px of the keypoints."""
    info, pixels, messages = shown
    bones, joints = messages[topics.MARKERS].markers
    assert bones.header.frame_id == joints.header.frame_id == info.header.frame_id == FRAME
    tracker = Tracker(TrackerConfig(height=1.75))
    skeleton, names = tracker.skeleton, tracker.layout.names
    centres = [n for n in names if n.split("_")[-1] in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")]
    assert len(centres) == 12  # keypoints of COCO that are joint centres
    seen = in_image(info, places(joints.points)[[skeleton.index(n) for n in centres]])
    error = np.linalg.norm(seen - pixels[[names.index(n) for n in centres]], axis=1)
    assert np.median(error) < 4 and error.max() < 12
    assert places(joints.points)[:, 2].min() > 1  # in front of the camera: z is forward
    ends = places(bones.points).reshape(-1, 2, 3)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    given = np.linalg.norm(skeleton.offsets, axis=1)[1:]
    assert np.allclose(lengths, given, atol=1e-9)
    published = places([p.position for p in messages[topics.JOINTS].poses])
    assert np.allclose(places(joints.points), published)


def test_image_markers_are_at_their_pixels(shown):
    """Bones are the projected markers, upright crosses the detector's points, diagonal ones near them."""
    info, pixels, messages = shown
    marker = messages[topics.IMAGE_MARKERS]
    assert marker.type == 2 and len(marker.points) == 2 * len(marker.outline_colors) and marker.scale > 0
    bones = messages[topics.MARKERS].markers[0]
    count = len(bones.points)
    assert np.abs(places(marker.points)[:count, :2] - in_image(info, places(bones.points))).max() < 1e-6
    detected, back = (
        coloured(marker, marker.outline_colors, c, 2).mean(axis=1)[::2, :2] for c in (DETECTED, REPROJECTED)
    )
    seen = np.isfinite(pixels).all(axis=1)
    assert np.abs(detected - pixels[seen]).max() < 1e-3  # the input is float32
    assert len(back) == len(pixels) and np.median(np.linalg.norm(back[seen] - detected, axis=1)) < 4
    assert (marker.lifetime.sec, marker.lifetime.nanosec) == (1, 0)


def test_image_markers_follow_the_number_of_points():
    """The same builder with another number of landmarks, and with missing ones, in successive messages."""
    builder = ImageMarkerBuilder(rosbags_backend(), [-1, 0])
    for missing in ([], [0], [0, 1, 2], [], [1]):
        for count in (3, 5):
            reprojected = np.arange(2.0 * count).reshape(count, 2) + 100
            detected = reprojected + 100
            detected[missing] = np.nan
            marker = builder.fill(0, FRAME, np.array([[1.0, 2], [3, 4]]), detected, reprojected)
            assert places(marker.points)[:2, :2].tolist() == [[1, 2], [3, 4]] and not places(marker.points)[:, 2].any()
            for points, colour, end in ((detected, DETECTED, [-5, 0]), (reprojected, REPROJECTED, [-5, -5])):
                present = points[np.isfinite(points).all(axis=1)]
                crosses = coloured(marker, marker.outline_colors, colour, 2)[:, :, :2].reshape(-1, 4, 2)
                assert np.array_equal(crosses.mean(axis=1), present)
                assert np.array_equal(crosses[:, 0], present + end)
            assert len(marker.points) == 2 + 4 * (2 * count - len(missing)) == 2 * len(marker.outline_colors)


def test_keypoint_markers_are_on_the_rays_of_the_keypoints(shown):
    info, pixels, messages = shown
    marker = messages[topics.KEYPOINT_MARKERS]
    assert marker.type == 7 and marker.header.frame_id == FRAME and len(marker.colors) == len(marker.points)
    detected = coloured(marker, marker.colors, DETECTED, 1)[:, 0]
    assert np.allclose(detected[:, 2], 1.0)
    seen = np.isfinite(pixels).all(axis=1)
    assert np.abs(in_image(info, detected) - pixels[seen]).max() < 0.01


def test_rviz_shows_existing_topics_with_matching_displays(rviz):
    shows = set()
    for display in rviz["Displays"]:
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is None or display["Class"] == "rviz_default_plugins/Camera":
            continue
        ours = OURS[topic["Value"]]
        assert DISPLAYS[display["Class"]] == ours.message_type, display["Name"]
        assert topic["Durability Policy"] == ("Transient Local" if ours.latched else "Volatile")
        assert topic["Reliability Policy"] == "Reliable" and topic["History Policy"] == "Keep Last"
        if display["Enabled"]:
            shows.add(topic["Value"])
    expected = (topics.MARKERS, topics.UNCERTAINTY_MARKERS, topics.KEYPOINT_MARKERS, topics.ROBOT_DESCRIPTION)
    assert shows == {full(name) for name in expected}
    assert rviz["Global Options"]["Fixed Frame"] == FRAME


def test_rviz_shows_the_skeleton_over_the_image(rviz):
    (camera,) = [d for d in rviz["Displays"] if d["Class"] == "rviz_default_plugins/Camera"]
    assert camera["Enabled"] and camera["Topic"]["Value"] == "image_raw"  # next to camera_info, from which RViz reads K
    names = {d["Name"] for d in rviz["Displays"]}
    hidden = {name for name, seen in camera["Visibility"].items() if not seen}
    assert hidden < names and not any(name.startswith(("Skeletons", "Detected")) for name in hidden)


def test_foxglove_shows_existing_topics(foxglove):
    panels = foxglove["configById"]
    shown = [t.lstrip("/") for t in panels["3D!skeleton"]["topics"]]
    plotted = [p["value"].split(".")[0].lstrip("/") for name in panels for p in panels[name].get("paths", ())]
    image = panels["Image!points"]["imageMode"]
    assert set(shown) | set(plotted) <= set(OURS)
    visible = {t.lstrip("/") for t, how in panels["3D!skeleton"]["topics"].items() if how["visible"]}
    assert visible == {full(topics.MARKERS), full(topics.UNCERTAINTY_MARKERS)}
    assert [t.lstrip("/") for t in image["annotations"]] == [full(topics.IMAGE_MARKERS)]
    assert OURS[full(topics.IMAGE_MARKERS)].message_type == "visualization_msgs/msg/ImageMarker"
    assert image["calibrationTopic"].lstrip("/") == topics.CAMERA_INFO
    assert panels["DiagnosticSummary!state"]["topicToRender"] == topics.DIAGNOSTICS
    order = joint_names(Skeleton.load("anthropometric", 1.75))
    for path in panels["Plot!knees"]["paths"]:
        assert order[int(path["value"].split("[")[1][:-1])] == path["label"]

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(foxglove["layout"])) == sorted(panels)


def rviz_view(view):
    """(position, axes) of RViz' orbit view, whose up is the frame's z. The rows of axes are right, up and forward."""
    yaw, pitch = view["Yaw"], view["Pitch"]
    focal = np.array([view["Focal Point"][axis] for axis in "XYZ"], dtype=float)
    towards = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.cross(-towards, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return focal + view["Distance"] * towards, np.array([right, np.cross(right, -towards), -towards])


def foxglove_view(state):
    """The same of Foxglove's camera: rotated by phi about x, then by -thetaOffset about z, from the view along -z."""
    turn = Rotation.from_euler("ZX", [-state["thetaOffset"], state["phi"]], degrees=True)
    right, up, back = turn.as_matrix().T
    return np.array(state["targetOffset"], dtype=float) + state["distance"] * back, np.array([right, up, -back])


@pytest.mark.parametrize("viewer", ["rviz", "foxglove"])
def test_a_person_is_upright_completely_visible_and_seen_from_the_camera(viewer, request):
    config = request.getfixturevalue(viewer)
    if viewer == "rviz":
        assert config["Views"]["Current"]["Class"] == "rviz_default_plugins/Orbit"
        place, axes = rviz_view(config["Views"]["Current"])
    else:
        place, axes = foxglove_view(config["configById"]["3D!skeleton"]["cameraState"])
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-6) and np.linalg.det(axes) < 0  # right, up, forward
    person = {"head": (0, -0.6, 3), "feet": (0, 1.05, 3), "left hand": (0.6, 0, 3), "right hand": (-0.6, 0, 3)}
    seen = {name: axes @ (np.array(point) - place) for name, point in person.items()}
    depth = {name: v[2] for name, v in seen.items()}
    assert min(depth.values()) > 1  # in front of the viewer
    picture = {name: v[:2] / v[2] for name, v in seen.items()}
    assert picture["head"][1] > picture["feet"][1] + 0.2
    assert picture["left hand"][0] > picture["right hand"][0] + 0.1
    assert abs(picture["head"][0] - picture["feet"][0]) < 0.05  # not tilted
    assert max(np.abs(v).max() for v in picture.values()) < np.tan(np.radians(45 / 2))  # fully visible, in 45 degrees
