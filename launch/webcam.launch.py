"""A camera, the detector and the tracker with its tools.

ros2 launch lassokin_ros webcam.launch.py height:=1.8 rviz:=true
ros2 launch lassokin_ros webcam.launch.py source:=walk.mp4 fov:=70

The arguments of tracker.launch.py (height, rviz, params, ...) may be given, too.
Each node gets namespace and use_sim_time.
"""

from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node

TRACKER = Path(__file__).resolve().parent / "tracker.launch.py"
DRIVERS = {
    "v4l2_camera": ("v4l2_camera_node", "camera_frame_id"),
    "usb_cam": ("usb_cam_node_exe", "frame_id"),
}
"""Executable of each camera driver, and its parameter for the frame. The first one with a calibration is used."""
OWN = "opencv"
"""The node `camera` of this package."""
CALIBRATIONS = Path.home() / ".ros" / "camera_info"
"""Where camera_calibration stores its result, and the drivers find it."""
DEVICES = Path("/sys/class/video4linux")
"""Where the kernel tells the cameras' names."""
FRAME = "camera_optical_frame"
TRUE = ("true", "1", "yes", "on")
"""Values of use_sim_time; tracker.launch.py refuses those that are neither true nor false."""
ARGUMENTS = {
    "source": (
        "0",
        "number or device of a webcam, a video file, a folder of images, or an address (all but the number by OpenCV)",
    ),
    "driver": (
        "",
        f"{', '.join(DRIVERS)} or {OWN}; empty: an installed driver that has a calibration of the camera, else {OWN}",
    ),
    "fov": ("", "field of view along the longer side of the image, degrees (by OpenCV)"),
    "calibration": ("", "calibration file of ROS (ost.yaml)"),
    "detector": ("mediapipe", "mediapipe, mediapipe_hands, or the path of a .task or .onnx file"),
    "height": ("", "the person's height, m; empty: the value of the parameter file"),
    "rviz": ("false", "start RViz"),
}


def generate_launch_description() -> LaunchDescription:
    """Arguments: see ARGUMENTS, or `ros2 launch lassokin_ros webcam.launch.py --show-args`."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    given = {name: str(context.launch_configurations[name]).strip() for name in ARGUMENTS}
    detector = given["detector"]
    defaults = {"landmarks": "coco17"}
    if not detector.endswith(".onnx"):
        defaults = {"landmarks": "mediapipe33", "params": "mediapipe"}
    if detector == "mediapipe_hands":
        defaults = {"landmarks": "mediapipe75", "params": "mediapipe_hands"}
    frame = str(context.launch_configurations.get("frame", "")).strip() or FRAME
    defaults["frame"] = frame
    settings = {name: value for name, value in defaults.items() if name not in context.launch_configurations}
    tracker = IncludeLaunchDescription(PythonLaunchDescriptionSource(str(TRACKER)), launch_arguments=settings.items())
    namespace, clock = (
        str(context.launch_configurations.get(name, "")).strip() for name in ("namespace", "use_sim_time")
    )
    common: dict[str, Any] = {"output": "screen", **({"namespace": namespace} if namespace else {})}
    sim_time = [{"use_sim_time": clock.lower() in TRUE}] if clock else []
    node = Node(
        package="lassokin_ros",
        executable="detector",
        name="detector",
        parameters=[{"detector": detector}, *sim_time],
        **common,
    )
    return [_camera(given, frame, sim_time, common), node, tracker]


def _camera(given: dict[str, str], frame: str, sim_time: list[dict], common: dict[str, Any]) -> Node:
    driver = given["driver"] or _driver(given)
    if driver == OWN:
        parameters = {"source": given["source"], "frame_id": frame}
        parameters.update({"fov": float(given["fov"])} if given["fov"] else {})
        parameters.update({"calibration": given["calibration"]} if given["calibration"] else {})
        return Node(
            package="lassokin_ros", executable="camera", name="camera", parameters=[parameters, *sim_time], **common
        )
    if driver not in DRIVERS:
        raise RuntimeError(f"driver:={driver}; expected one of: {', '.join([*DRIVERS, OWN])}")
    if not given["source"].isdecimal() or given["fov"]:
        raise RuntimeError(f"driver:={driver} takes the number of a webcam as source, and no fov; use driver:={OWN}")
    executable, frame_parameter = DRIVERS[driver]
    parameters = {"video_device": f"/dev/video{given['source']}", frame_parameter: frame}
    if given["calibration"]:
        parameters["camera_info_url"] = Path(given["calibration"]).expanduser().resolve().as_uri()
    return Node(package=driver, executable=executable, name="camera", parameters=[parameters, *sim_time], **common)


def _driver(given: dict[str, str]) -> str:
    """Return the driver to use. Without a calibration only the node `camera` publishes a usable camera_info."""
    if not given["source"].isdecimal() or given["fov"]:
        return OWN
    calibrated = [driver for driver in DRIVERS if given["calibration"] or _is_calibrated(driver, given["source"])]
    return next(filter(_is_installed, calibrated), OWN)


def _is_calibrated(driver: str, number: str) -> bool:
    """Whether the driver finds a calibration: v4l2_camera by the camera's name, usb_cam by a fixed one."""
    name, device = "default_cam", DEVICES / f"video{number}" / "name"
    if driver == "v4l2_camera":
        name = device.read_text(encoding="utf-8").strip().lower().replace(" ", "_") if device.is_file() else ""
    return (CALIBRATIONS / f"{name}.yaml").is_file()


def _is_installed(package: str) -> bool:
    try:
        get_package_share_directory(package)
    except PackageNotFoundError:
        return False
    return True
