"""Launch files as modules, with recording replacements of `launch`, which is not on PyPI."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

ROOT = Path(__file__).resolve().parents[2]


class Recorded(SimpleNamespace):
    """Replaces any class of launch and records its arguments."""

    def __init__(self, *args, **kwargs):
        super().__init__(args=args, **kwargs)


class NotFound(LookupError):
    """Replaces PackageNotFoundError."""


ACTIONS = ("DeclareLaunchArgument", "ExecuteProcess", "IncludeLaunchDescription", "LogInfo", "OpaqueFunction")


def replace_launch(monkeypatch):
    """Replace the packages that launch files import. Returns the set of the installed packages, to be changed."""
    installed = {"robot_state_publisher"}

    def share(package):
        if package not in installed:
            raise NotFound
        return str(ROOT)

    found = {"get_package_prefix": share, "get_package_share_directory": share}
    for name, members in {
        "ament_index_python": {},
        "ament_index_python.packages": {"PackageNotFoundError": NotFound, **found},
        "launch": {"LaunchContext": Recorded, "LaunchDescription": Recorded},
        "launch.actions": dict.fromkeys(ACTIONS, Recorded),
        "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Recorded},
        "launch_ros": {},
        "launch_ros.actions": {"Node": Recorded},
        "launch_ros.parameter_descriptions": {"ParameterValue": Recorded},
    }.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    return installed


def load(name):
    """The launch file of this name as a module."""
    spec = importlib.util.spec_from_file_location(f"{name}_launch", ROOT / "launch" / f"{name}.launch.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def actions_of(module, required=(), **given):
    """(actions of a launch file for these arguments, the values of all arguments). required: those without default."""
    *arguments, function = module.generate_launch_description().args[0]
    defaults = {each.args[0]: each.default_value for each in arguments if hasattr(each, "default_value")}
    assert all(each.description for each in arguments)
    assert {each.args[0] for each in arguments} - set(defaults) == set(required)
    context = SimpleNamespace(launch_configurations={**defaults, **given})
    return function.function(context), context.launch_configurations
