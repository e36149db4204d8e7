"""3D human motion from 2D keypoints, one certified lasso per frame.

The public interface is what `__all__` lists; every other name in this package is internal and may change.

    from lassokin_ros import Lens, Tracker, TrackerConfig, observation_from_pixels

The names are imported on first use, so that commands can set thread limits before numpy is imported.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lassokin_ros.core.config import TrackerConfig
    from lassokin_ros.core.errors import LassokinError
    from lassokin_ros.core.estimate import Estimate
    from lassokin_ros.core.evidence.evidence import Evidence
    from lassokin_ros.core.observation import CameraPose, Observation, Rejection, Status
    from lassokin_ros.core.tracker import Tracker
    from lassokin_ros.pipeline.camera.lens import Lens
    from lassokin_ros.pipeline.from_pixels import observation_from_pixels
    from lassokin_ros.pipeline.session import Session
    from lassokin_ros.pipeline.settings import NodeSettings
    from msg_adapters.keypoints import Keypoints

__all__ = [
    "CameraPose",
    "Estimate",
    "Evidence",
    "Keypoints",
    "LassokinError",
    "Lens",
    "NodeSettings",
    "Observation",
    "Rejection",
    "Session",
    "Status",
    "Tracker",
    "TrackerConfig",
    "observation_from_pixels",
]

_MODULES = {
    "Estimate": "lassokin_ros.core.estimate",
    "CameraPose": "lassokin_ros.core.observation",
    "Evidence": "lassokin_ros.core.evidence.evidence",
    "Keypoints": "msg_adapters.keypoints",
    "LassokinError": "lassokin_ros.core.errors",
    "Lens": "lassokin_ros.pipeline.camera.lens",
    "NodeSettings": "lassokin_ros.pipeline.settings",
    "Observation": "lassokin_ros.core.observation",
    "Rejection": "lassokin_ros.core.observation",
    "Session": "lassokin_ros.pipeline.session",
    "Status": "lassokin_ros.core.observation",
    "Tracker": "lassokin_ros.core.tracker",
    "TrackerConfig": "lassokin_ros.core.config",
    "observation_from_pixels": "lassokin_ros.pipeline.from_pixels",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name == "__version__":
        return import_module("lassokin_ros.common.command_line").version()
    if name not in _MODULES:
        raise AttributeError(f"module 'lassokin_ros' has no attribute '{name}'; it offers {', '.join(__all__)}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__
