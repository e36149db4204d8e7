"""The tracker with its tools: RViz, a robot_state_publisher for the human, a recording.

ros2 launch lassokin_ros tracker.launch.py keypoints:=/detector/keypoints camera:=/camera frame:=camera_optical_frame
ros2 launch lassokin_ros tracker.launch.py params:=webcam_yolo bag:=walk rviz:=true
"""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo, OpaqueFunction
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from lassokin_ros.common.command_line import missing_package

try:
    from lassokin_ros.core.yaml_files import user_path
    from lassokin_ros.pipeline.outputs.robot_description import urdf_from_settings
    from lassokin_ros.pipeline.outputs.topics import STATE_PUBLISHER
    from lassokin_ros.pipeline.parameter_files import file_parameters, offline_settings
    from lassokin_ros.pipeline.settings import ALL, OFF
except ImportError as error:
    raise RuntimeError(missing_package(error)) from None

CONFIG = Path(__file__).resolve().parent.parent / "config"
PARAMETERS = {
    "height": "the person's height, m; 0: measured by depth, several cameras or a floor, else assumed",
    "camera_pitch": "the camera looks down by this angle, rad",
    "camera_roll": "the camera's right side is down by this angle, rad",
    "cameras": "names of several cameras, such as [left, right], with the topics <name>/keypoints and so on",
    "fixed_frame": "frame with z up, such as odom, in which the skeleton is kept and published; TF places the cameras",
    "extrinsics": "poses of several cameras: given, check or learn",
    "landmarks": "landmark layout of the detector, such as coco17",
    "keypoints_type": "message type of the keypoints",
    "depth": "topic of depth images that are registered to the colour image",
    "max_people": "people followed at once",
    "frame_prefix": "precedes the names of TF frames and URDF links; ~ is the node's name",
}
"""Arguments that set the parameter of the same name. Empty: the value of the parameter file."""
ARGUMENTS = {
    "keypoints": ("keypoints", "topic of the 2D keypoints"),
    "camera": ("", "namespace of the camera, for camera_info and RViz; empty for the topic camera_info"),
    "params": ("tracker", "YAML file of parameters, or the name of a file in config/"),
    "frame": ("", "the camera's optical frame, for RViz; empty for that of its configuration"),
    "bag": ("", "recording to play, with its own clock"),
    "rviz": ("false", "start RViz"),
    "frames": ("true", "TF of the limbs: of one person by a robot_state_publisher, of several by the tracker"),
    "use_sim_time": ("", "take the time from /clock; empty: if a recording is played, or the parameter file says so"),
    "namespace": ("", "namespace of the nodes"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    **{name: ("", text) for name, text in PARAMETERS.items()},
}
LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
NODE = "tracker"
PUBLISH_FREQUENCY = 120.0
"""Hz; the default of robot_state_publisher forwards 20 joint states per second and drops the others."""
BOOLEANS = {"true": True, "1": True, "yes": True, "on": True, "false": False, "0": False, "no": False, "off": False}


def generate_launch_description() -> LaunchDescription:
    """Arguments: see ARGUMENTS, or `ros2 launch lassokin_ros tracker.launch.py --show-args`."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    """Check every argument, then return what is started."""
    configurations = context.launch_configurations
    given = {name: str(configurations[name]).strip() for name in ARGUMENTS}
    show_rviz, frames = _boolean("rviz", given["rviz"]), _boolean("frames", given["frames"])
    if given["log_level"].lower() not in LOG_LEVELS:
        raise RuntimeError(f"log_level:={given['log_level']}; expected one of: {', '.join(LOG_LEVELS)}")
    params = user_path(given["params"]) if Path(given["params"]).suffix else CONFIG / f"{given['params']}.yaml"
    names = [name for name in PARAMETERS if given[name]]
    assignments = [f"{name}:={given[name]}" for name in names]
    node = f"{given['namespace'].strip('/')}/{NODE}".lstrip("/")
    # raises for a bad value, before anything starts
    tracker, settings = offline_settings([params], assignments, node=node)
    values = {**vars(tracker), **vars(settings)}
    overrides = {name: list(values[name]) if name == "cameras" else values[name] for name in names}
    if frames and settings.several_people and settings.publish_tf == OFF:
        overrides["publish_tf"] = ALL
    frames = frames and not settings.several_people and settings.publish_tf != ALL
    warnings = [*_misspelt(configurations), *_unread(given, settings.camera_names)]
    if frames and not _is_installed("robot_state_publisher"):
        frames, overrides["publish_tf"] = False, ALL
        warnings.append(LogInfo(msg="robot_state_publisher is not installed: the tracker publishes TF of the limbs"))
    common: dict[str, Any] = {"namespace": given["namespace"]} if given["namespace"] else {}
    clock = given["use_sim_time"] or ("true" if given["bag"] else "")
    chosen = {"use_sim_time": _boolean("use_sim_time", clock)} if clock else {}
    sim_time = chosen or {"use_sim_time": file_parameters(params, node).get("use_sim_time", False)}
    actions = [*warnings, _tracker(given, params, [chosen, overrides], common)]
    if frames:
        actions.append(_state_publisher(urdf_from_settings(tracker, settings, node), sim_time, common))
    if show_rviz:
        of_camera = "lassokin_people.rviz" if settings.several_people else "lassokin.rviz"
        config = CONFIG / ("lassokin_world.rviz" if settings.fixed_frame else of_camera)
        frame = settings.fixed_frame or given["frame"]
        actions.append(_rviz(config, given["camera"].rstrip("/"), frame, sim_time, common))
    return [*actions, *_bag(given["bag"])]


def _is_installed(package: str) -> bool:
    """Return True if launch finds a package. A node of a missing one would end the launch, and leave its processes."""
    try:
        get_package_prefix(package)
    except LookupError:
        return False
    return True


def _misspelt(configurations: Mapping[str, Any]) -> list[LogInfo]:
    """Warn of each undeclared argument that resembles a declared one.

    It is no error: a launch file that includes this one may declare the argument for another.
    """
    warnings = []
    for name in configurations:
        if name not in ARGUMENTS and (close := get_close_matches(name, ARGUMENTS, 1, cutoff=0.8)):
            words = f"tracker.launch.py has no argument '{name}', which is ignored here; did you mean '{close[0]}'?"
            warnings.append(LogInfo(msg=words))
    return warnings


def _unread(given: Mapping[str, str], cameras: Sequence[str]) -> list[LogInfo]:
    """Warn of topics that are given beside names of cameras. Why it is no error: see _misspelt.

    cameras: an empty name stands for the camera without one.
    """
    names = [name for name in ("keypoints", "camera") if any(cameras) and given[name] != ARGUMENTS[name][0]]
    read = ", ".join(f"{camera}/{topic}" for camera in cameras for topic in ("keypoints", "camera_info"))
    words = "with cameras the tracker does not use the argument '{}'; it reads " + read
    return [LogInfo(msg=words.format(name)) for name in names]


def _boolean(name: str, text: str) -> bool:
    if text.lower() not in BOOLEANS:
        raise RuntimeError(f"{name}:={text}; expected one of: {', '.join(BOOLEANS)}")
    return BOOLEANS[text.lower()]


def _tracker(given: Mapping[str, str], params: Path, settings: list[dict], common: Mapping[str, Any]) -> Node:
    camera_info = f"{given['camera'].rstrip('/')}/camera_info" if given["camera"] else "camera_info"
    return Node(
        package="lassokin_ros",
        executable="tracker",
        name=NODE,
        output="screen",
        parameters=[str(params), *(values for values in settings if values)],
        arguments=["--ros-args", "--log-level", given["log_level"].lower()],
        remappings=[("keypoints", given["keypoints"]), ("camera_info", camera_info)],
        **common,
    )


def _state_publisher(description: str, sim_time: dict, common: Mapping[str, Any]) -> Node:
    """TF of the limbs from ~/joint_states.

    Its own robot_description is a private topic: the tracker publishes the URDF, and sets it here when it changes.
    """
    return Node(
        package="robot_state_publisher",
        executable="robot_state_publisher",
        name=STATE_PUBLISHER,
        parameters=[
            {
                "robot_description": ParameterValue(description, value_type=str),
                "publish_frequency": PUBLISH_FREQUENCY,
            },
            sim_time,
        ],
        remappings=[("joint_states", f"{NODE}/joint_states"), ("robot_description", "~/robot_description")],
        **common,
    )


def _rviz(config: Path, camera: str, frame: str, sim_time: dict, common: Mapping[str, Any]) -> Node:
    """RViz with the camera image. RViz derives the name of camera_info from that of the image; both are remapped."""
    fixed_frame = ["-f", frame] if frame else []
    return Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(config), *fixed_frame],
        parameters=[sim_time],
        remappings=[(name, f"{camera}/{name}") for name in ("image_raw", "camera_info")] if camera else [],
        **common,
    )


def _bag(bag: str) -> list:
    play = ["ros2", "bag", "play", str(user_path(bag)), "--clock"]
    return [ExecuteProcess(cmd=play, output="screen")] if bag else []
