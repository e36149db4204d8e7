"""The node `viewer` on real DDS: its recording of a tracker in another process, and its refusals."""

import sys

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("cv2")
pytest.importorskip("rerun", reason="the viewer needs rerun-sdk")

from geometry_msgs.msg import Point, Pose, PoseArray  # noqa: E402
from live import BACKEND, NO_HANDLERS, NodeProcess, Peer, stamp_of  # noqa: E402
from messages import HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import Image, PointCloud2  # noqa: E402
from std_msgs.msg import String  # noqa: E402

from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.pipeline.outputs.urdf import urdf  # noqa: E402
from lassokin_ros.video.rerun_scene import RerunScene, ViewError  # noqa: E402
from lassokin_ros.viewer.node import ViewerNode  # noqa: E402
from msg_adapters.inputs import rgb_image  # noqa: E402

COMMAND = [sys.executable, "-m", "lassokin_ros.viewer.command"]
LEAST = 5
PATHS = (
    "camera/image", "camera/image/keypoints", "camera/image/skeleton", "body/skeleton", "body/uncertainty",
    "angles/left_knee", "errors/reprojection", "errors/uncertainty",
)  # fmt: skip


@pytest.fixture
def logged(monkeypatch):
    """What the scene logs: stamp in ns and path; stamp and arguments of the skeletons; arguments of the outlines."""
    result, skeletons, outlines, now = [], [], [], [None]
    set_time, log, add_skeleton = RerunScene.set_time, RerunScene._log, RerunScene.add_skeleton
    add_outline = RerunScene.add_outline

    def keep_time(self, timestamp):
        now[0] = int(timestamp.astype(np.int64))
        set_time(self, timestamp=timestamp)

    def keep(self, path, what, static=False):
        if not static:
            result.append((now[0], path))
        log(self, path, what, static)

    def keep_skeleton(self, place, *arguments):
        skeletons.append((now[0], arguments))
        add_skeleton(self, place, *arguments)

    def keep_outline(self, place, *arguments):
        outlines.append(arguments)
        add_outline(self, place, *arguments)

    monkeypatch.setattr(RerunScene, "set_time", keep_time)
    monkeypatch.setattr(RerunScene, "_log", keep)
    monkeypatch.setattr(RerunScene, "add_skeleton", keep_skeleton)
    monkeypatch.setattr(RerunScene, "add_outline", keep_outline)
    return result, skeletons, outlines


@pytest.fixture
def viewer(tmp_path):
    """(node, function that serves its next callback, file)."""
    context, file = rclpy.Context(), tmp_path / "walk.rrd"
    rclpy.init(context=context, signal_handler_options=NO_HANDLERS)
    node = ViewerNode(file, False, context=context, namespace="/view")
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, lambda: executor.spin_once(timeout_sec=0.01), file
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def test_a_recording_contains_the_published_messages_at_their_stamps(viewer, logged):
    node, serve, file = viewer
    log, skeletons, outlines = logged
    pixels, sent = pixels_of_motion(100, hz=30.0), []
    with NodeProcess("/view", "-p", "height:=1.75"), Peer("/view") as peer:
        images = peer.node.create_publisher(Image, "image_raw", 5)

        def enough():
            serve()
            recorded = [path for _, path in log]
            if len(peer.got[topics.JOINTS]) >= len(sent) - 2 and len(sent) < len(pixels):
                stamp = peer.start_ns + len(sent) * 33_333_333
                sent.append(stamp)
                peer.send_camera()
                images.publish(rgb_image(BACKEND, stamp, "lens", np.zeros((HEIGHT, WIDTH, 3), np.uint8)))
                peer.send(stamp, pixels[len(sent) - 1])
            return all(recorded.count(path) >= LEAST for path in PATHS)

        peer.start(pixels[0])
        peer.clear()
        peer.spin_until(enough, what="a recording of everything")
        published = {
            stamp_of(m): [(p.position.x, p.position.y, p.position.z) for p in m.poses] for m in peer.got[topics.JOINTS]
        }
        bad = PointCloud2(point_step=3)
        bad.header.stamp.sec = 5
        node._log(node._people[""]._on_uncertainty, bad)  # is reported, and raises nothing
    ours = Skeleton.load("anthropometric", 1.75)
    both = [(stamp, shown) for stamp, shown in skeletons if stamp in published]  # one peer may lag behind the other
    assert len(both) >= LEAST - 2 and {stamp for stamp, _ in both} <= set(sent)
    for stamp, (skeleton, joints) in both:
        assert np.allclose(joints, published[stamp])
        assert list(skeleton.joint_names) == list(ours.joint_names) and list(skeleton.parents) == list(ours.parents)
    for _, outline in outlines:
        assert np.nanmax(np.abs(outline - outline.mean(axis=0))) > 20  # px
    assert len(outlines) >= LEAST - 2
    assert {stamp for stamp, path in log if path in PATHS[:4]} & set(sent)
    assert not file.exists()
    node.destroy_node()
    reader = pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read recordings").RrdReader
    rows = {}
    for chunk in reader(file).stream().to_chunks():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + (0 if chunk.is_static else chunk.num_rows)
    assert all(rows[f"/{path}"] >= LEAST for path in PATHS), rows


def test_a_skeleton_in_a_fixed_frame_is_not_projected_as_if_the_camera_were_there(viewer, logged, monkeypatch):
    node, _, _ = viewer
    _, skeletons, outlines = logged
    axes = []
    monkeypatch.setattr(RerunScene, "set_axes", lambda scene, z_up: axes.append(z_up))
    skeleton = Skeleton.load("anthropometric", 1.75)
    person = node._people[""]
    person._on_description(String(data=urdf(skeleton, "lens")))
    node._on_camera(camera_info(BACKEND, frame_id="lens"))
    for frame in ("map", "map", "lens", ""):
        joints = PoseArray(poses=[Pose(position=Point(x=x, y=y, z=3.0 + z)) for x, y, z in skeleton.rest_positions])
        joints.header.frame_id = frame
        person._on_joints(joints)
    assert len(skeletons) == 4 and len(outlines) == 2 and axes == [True, False]


def test_a_leading_slash_in_a_frame_id_makes_no_other_frame(viewer):
    """The tracker leaves it out in its outputs."""
    node, _, _ = viewer
    keypoints = cloud(BACKEND, 0, np.zeros((17, 2)), frame_id="/eye")
    for log, message in ((node._on_camera, camera_info(BACKEND, frame_id="/lens")), (node._on_keypoints, keypoints)):
        log(message)
    assert [node.is_of_camera(name) for name in ("lens", "/lens", "eye", "map")] == [True, True, True, False]


def test_the_skeleton_of_a_rectified_image_is_drawn_with_its_lens(tmp_path):
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=NO_HANDLERS)
    rectified = Parameter("rectified", value=True)
    node = ViewerNode(tmp_path / "walk.rrd", False, context=context, parameter_overrides=[rectified])
    raw = camera_info(BACKEND, distortion_model="plumb_bob", d=[0.1, 0.0, 0.0, 0.0, 0.0])
    raw.p = raw.p * 0.9
    node._on_camera(raw)
    lens = node.lens
    assert np.allclose(lens.K[:2], 0.9 * raw.k.reshape(3, 3)[:2]) and not lens.model
    node.destroy_node()
    context.try_shutdown()


def test_topics_of_people_are_added_and_removed(viewer):
    node, _, _ = viewer

    def people():
        return {s.topic_name.split("/")[-2] for s in node.subscriptions if "bodies" in s.topic_name} - {"bodies"}

    for present in ("p1,p2", "p2", ""):
        node._on_tracked(String(data=present))
        assert people() == set(filter(None, present.split(",")))


def test_an_existing_file_is_one_line_and_exit_code_2(tmp_path):
    there = tmp_path / "there.rrd"
    there.write_bytes(b"kept")
    code, said = NodeProcess("/none", command=[*COMMAND, "--save", str(there)]).stop()
    assert code == 2 and said.strip() == f"viewer: '{there}' exists already; choose another name or add --force"
    assert [(f.name, f.read_bytes()) for f in tmp_path.iterdir()] == [("there.rrd", b"kept")]


def test_a_recording_of_another_suffix_is_refused(tmp_path):
    with pytest.raises(ViewError, match=r"^viewer --save '.*walk.bag'; expected a name that ends in .rrd, or none"):
        ViewerNode(tmp_path / "walk.bag", False)
    assert not list(tmp_path.iterdir())
