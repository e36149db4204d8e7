"""`colcon build` of this package, as on a ROS machine, and the installed executable on DDS."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("colcon_core")

from live import NodeProcess, Peer  # noqa: E402
from messages import pixels_of_motion  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SOURCES = (
    "lassokin_ros",
    "msg_adapters",
    "resource",
    "launch",
    "config",
    "examples",
    "LICENSE",
    "setup.py",
    "setup.cfg",
    "package.xml",
    "pyproject.toml",
)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A workspace in which the package has been built."""
    folder = tmp_path_factory.mktemp("colcon")
    source = folder / "src" / "lassokin_ros"
    source.mkdir(parents=True)
    for name in SOURCES:
        path = ROOT / name
        if path.is_dir():
            shutil.copytree(path, source / name, ignore=shutil.ignore_patterns("*.so"))
        else:
            shutil.copy(path, source / name)
    environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix, "COLCON_LOG_PATH": str(folder / "log")}
    environment.pop("PYTHONPATH", None)
    command = [sys.executable, "-m", "colcon", "build", "--event-handlers", "console_direct+"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_all_files_are_installed(workspace):
    prefix = workspace / "install" / "lassokin_ros"
    commands = {path.name for path in (prefix / "lib" / "lassokin_ros").iterdir()}
    assert commands == {"tracker", "replay", "detector", "camera", "viewer", "imitate", "lassokin"}
    share = prefix / "share" / "lassokin_ros"
    folders = ("launch/tracker.launch.py", "config/tracker.yaml", "examples/hand_over.py")
    for name in ("package.xml", "LICENSE", *folders, "hook/ament_prefix_path.sh"):
        assert (share / name).is_file(), name
    assert (prefix / "share/ament_index/resource_index/packages/lassokin_ros").is_file()
    assert list(prefix.rglob("core/body/skeletons/anthropometric.yaml"))
    assert list(prefix.rglob("core/body/layouts/coco17.yaml"))
    assert list(prefix.rglob("core/network/depth_network.npz"))
    assert {path.suffix for path in prefix.rglob("replay/report/plotly-gl3d.*")} == {".js", ".LICENSE"}
    assert not list(prefix.rglob("training"))
    can_compile = shutil.which("cc") and Path(sysconfig.get_path("include"), "Python.h").is_file()
    assert bool(list(prefix.rglob("core/_kernel*.so"))) == bool(can_compile)


def test_lassokin_is_run_by_its_path_only(workspace):
    """As `ros2 run lassokin_ros lassokin` does: colcon puts lib/lassokin_ros on no PATH."""
    environment = {"PATH": "/usr/bin:/bin", "AMENT_PREFIX_PATH": sys.prefix}
    script = "source install/setup.bash; command -v lassokin; install/lassokin_ros/lib/lassokin_ros/lassokin --help"
    done = subprocess.run(["bash", "-c", script], cwd=workspace, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("The command `lassokin`"), done.stdout + done.stderr


def test_the_installed_tracker_answers(workspace):
    script = f'source install/setup.bash && exec {workspace}/install/lassokin_ros/lib/lassokin_ros/tracker "$@"'
    environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix}
    environment.pop("PYTHONPATH", None)
    node = NodeProcess(
        "/installed",
        "--params-file",
        f"{workspace}/install/lassokin_ros/share/lassokin_ros/config/tracker.yaml",
        command=["bash", "-c", script, "tracker"],
        env=environment,
        folder=workspace,
    )
    with node, Peer("/installed") as peer:
        peer.start(pixels_of_motion(1)[0])
        assert peer.got[topics.JOINT_STATES]
        loaded = Path(f"/proc/{node.process.pid}/cmdline").read_text().split("\0")
        assert any("install/lassokin_ros/lib/lassokin_ros/tracker" in part for part in loaded)
