"""Depth images of a body of spheres along its bones, as from a depth camera registered to the colour camera."""

import numpy as np
from messages import FOCAL, FRAME, HEIGHT, WIDTH, bytes_field

from lassokin_ros.core.body.landmarks import SURFACE
from msg_adapters.output_messages.builders import set_header

BACKGROUND = 6.0
"""m: depth of the wall."""
SPHERES = 8
"""Spheres per bone."""


def render(skeleton, positions, scale=1.0, background=BACKGROUND):
    """(height, width) m: the depth of the body with joints (n, 3) m, camera frame. scale: of the resolution."""
    shape = round(HEIGHT * scale), round(WIDTH * scale)
    image = np.full(shape, background)
    focal, centre = FOCAL * scale, (np.array(shape[::-1]) - 1 + (1 - scale)) / 2
    for place, radius in zip(*_spheres(skeleton, positions)):
        middle = focal * place[:2] / place[2] + centre
        reach = focal * radius / place[2]
        low = np.clip(np.floor(middle - reach), 0, shape[::-1]).astype(int)
        high = np.clip(np.ceil(middle + reach) + 1, 0, shape[::-1]).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        square = (radius**2) - ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) * (place[2] / focal) ** 2
        depth = np.where(square > 0, place[2] - np.sqrt(np.maximum(square, 0)), np.inf)
        window = image[low[1] : high[1], low[0] : high[0]]
        np.minimum(window, depth, out=window)
    return image


def _spheres(skeleton, positions):
    """Centres (k, 3) m and radii (k,) m."""
    radii = np.array(
        [SURFACE.get(name.removeprefix("left_").removeprefix("right_"), 0.03) for name in skeleton.joint_names]
    )
    child = np.arange(1, skeleton.joint_count)
    parent = skeleton.parents[child]
    share = np.linspace(0, 1, SPHERES)[:, None]
    places = positions[parent] + share[..., None] * (positions[child] - positions[parent])[None]
    sizes = skeleton.height * (radii[parent] + share * (radii[child] - radii[parent]))
    return places.reshape(-1, 3), sizes.ravel()


def depth_message(backend, stamp_ns, depth, encoding="16UC1", frame_id=FRAME, big_endian=False, padding=0):
    """sensor_msgs/Image of depths (h, w) m; padding: bytes at the end of each row."""
    message = backend.make("sensor_msgs/msg/Image")
    set_header(message.header, stamp_ns, frame_id)
    values = np.round(1000 * depth).astype(np.uint16) if encoding != "32FC1" else depth.astype(np.float32)
    values = values.astype(values.dtype.newbyteorder(">" if big_endian else "<"))
    rows = np.frombuffer(values.tobytes(), np.uint8).reshape(len(values), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    message.height, message.width = depth.shape
    message.encoding, message.is_bigendian, message.step = encoding, int(big_endian), rows.shape[1]
    message.data = bytes_field(backend, rows.tobytes())
    return message
