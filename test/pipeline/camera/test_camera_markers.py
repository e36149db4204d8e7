"""The places of the cameras on ~/markers."""

import numpy as np
from camera_rig import MAP, START_NS, Play, eye, turning_eye
from messages import FOCAL, HEIGHT, WIDTH, rosbags_backend
from scipy.spatial.transform import Rotation

from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.outputs.scene_messages import MARKERS_EVERY_S, CameraMarkers
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND = rosbags_backend()


def seen_by(eyes, settings, seconds, play=None, tf=True):
    """Cameras after their images at these times, s."""
    play = play or Play(eyes, settings)
    for now in seconds:
        play.run(1 / 30, begin=now, tf=tf)
    return play


def pyramid(marker):
    """Corners in the marker's frame, m: the four of the image, in the order of CORNERS, and the camera's centre."""
    points = np.array([[p.x, p.y, p.z] for p in marker.points])
    p, q = marker.pose.position, marker.pose.orientation
    turn = Rotation.from_quat([q.x, q.y, q.z, q.w])
    return turn.apply(np.vstack([points[1::4], points[:1]])) + [p.x, p.y, p.z]


def test_each_camera_has_a_pyramid_of_its_field_of_view_and_its_name():
    eyes = [eye("left", 0), eye("right", 90)]
    settings = NodeSettings(cameras=("left", "right"), fixed_frame=MAP)
    play = seen_by(eyes, settings, np.arange(3) / 30)
    message = CameraMarkers(BACKEND, play.session).build(START_NS, 0.0)
    assert [(one.ns, one.id, one.text) for one in message.markers] == [
        ("cameras", 0, ""),
        ("camera_names", 0, "left"),
        ("cameras", 1, ""),
        ("camera_names", 1, "right"),
    ]
    corners = np.array([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]])
    for one, marker in zip(eyes, message.markers[::2]):
        assert marker.header.frame_id == MAP and marker.header.stamp.sec == START_NS // 10**9
        seen = one.pose_at(0).into_camera(pyramid(marker))
        assert np.allclose(seen[4], 0, atol=1e-9) and (seen[:4, 2] > 0.1).all()
        assert np.allclose(seen[:4, :2] / seen[:4, 2:] * FOCAL + [WIDTH / 2, HEIGHT / 2], corners, atol=1e-6)
    people = FrameMessages(BACKEND, play.session.tracker.skeleton, config=settings)
    ((_, skeleton),) = people.build(play.results[-1].frame, {topics.MARKERS})
    taken = {(one.ns, one.id) for one in skeleton.markers}
    assert taken and not taken & {(one.ns, one.id) for one in message.markers}


def test_a_camera_that_moves_is_followed_and_one_without_a_pose_is_left_out():
    robot = turning_eye("camera", 0.5)
    play = seen_by([robot], NodeSettings(fixed_frame=MAP), [0.0])
    markers = CameraMarkers(BACKEND, play.session)
    places = [pyramid(markers.build(START_NS, 0.0).markers[0]).copy()]
    seen_by([robot], None, [0.1, 0.2, 0.3], play)
    assert markers.build(START_NS, 0.9 * MARKERS_EVERY_S) is None  # not yet due
    places.append(pyramid(markers.build(START_NS, 1.1 * MARKERS_EVERY_S).markers[0]))
    turn = np.linalg.norm(places[1][:4] - places[0][:4], axis=1)
    assert 0.02 < turn.min() and turn.max() < 0.1  # 0.15 rad at 0.3 m and more
    assert np.allclose(robot.pose_at(0.3).into_camera(places[1])[4], 0, atol=1e-6)
    seen_by([robot], None, [5.0], play, tf=False)
    assert markers.build(START_NS, 1.0) is None


def test_cameras_without_a_fixed_frame_are_in_that_of_the_first_and_one_alone_has_no_marker():
    eyes = [eye("left", 0), eye("right", 90)]
    play = seen_by(eyes, NodeSettings(cameras=("left", "right")), [0.0])
    message = CameraMarkers(BACKEND, play.session).build(START_NS, 0.0)
    assert {one.header.frame_id for one in message.markers} == {eyes[0].frame}
    assert np.allclose(pyramid(message.markers[0])[4], 0)
    alone = seen_by(eyes[:1], NodeSettings(), [0.0], tf=False)
    assert CameraMarkers(BACKEND, alone.session).build(START_NS, 0.0) is None
