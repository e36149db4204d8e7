"""Kinds of damage to a good message, as faulty software may cause them. Every draw has a seed.

Each function changes a message of rosbags in place, with a numpy generator; the values can be serialised.
"""

from copy import deepcopy

import numpy as np
from detector_messages import backend

from msg_adapters.output_messages.builders import set_header

ODD = [np.nan, np.inf, -np.inf, 1e30, -1e30, 0.0, -0.0, 1e-30, -1.0, 3.4e38, 5e5, 1e4, 87.0, 1.5, 0.3, -0.7]
SIZES = [0, 1, 2, 3, 15, 16, 17, 31, 32, 48, 255, 4096, 4097, 65535, 2**31 - 1, 2**31, 2**32 - 1]
IDS = [-(2**31), -1, 0, 1, 16, 17, 18, 69, 70, 1000, 2**31 - 1]
NAMES = ["", "map", "tracker/head", "tracker/pelvis", "a" * 300, "a\x00b", 'quo"te<&>']
NAMES += ["\u202eabc", "frame with spaces", "é", "/x//y"]
STEP_NS = 33_333_333


def odd(random):
    return ODD[random.integers(len(ODD))]


def size(random):
    return SIZES[random.integers(len(SIZES))]


def text(random):
    return NAMES[random.integers(len(NAMES))]


def stamp(message, random, now_ns):
    """Zero, from the past, a little or very early, in another unit, the number of a frame, no time at all."""
    kind = random.integers(11)
    if kind >= 7:
        seconds, rest = divmod(now_ns, 10**9)
        other = (seconds * 10**9 + rest // 1000, now_ns // 1000, now_ns // 10**6, now_ns // STEP_NS)[kind - 7]
        set_header(message.header, other, message.header.frame_id)
    elif kind == 6:
        message.header.stamp.sec = -int(random.integers(1, 2**31))
    elif kind == 5:
        message.header.stamp.nanosec = int(random.integers(10**9, 2**32))
    else:
        offsets = (-(now_ns - 1), -now_ns, -int(1e9), 10_000_000_000, 2**31 * 10**9 - 1 - now_ns)
        set_header(message.header, now_ns + offsets[kind], message.header.frame_id)


def frame_id(message, random, now_ns):
    message.header.frame_id = text(random)


PLACES = [-10.0, -1.0, 0.5, 100.0, 123.4, 5000.0]


def one_coordinate(xy, random):
    """Give some of the points (k, 2) the same x or y, in place."""
    xy[some(random, len(xy)), random.integers(2)] = PLACES[random.integers(len(PLACES))]


def some(random, count):
    """Between one and all of `count` indices."""
    return random.permutation(count)[: random.integers(1, count + 1)] if count else []


# PointCloud2


POINT = [("x", "<f4"), ("y", "<f4"), ("confidence", "<f4"), ("id", "<u4"), ("person", "<i4")]


def cloud_array(message):
    kind = np.dtype(POINT[: 5 if len(message.fields) > 4 else 4])
    data = bytes(message.data)
    return np.frombuffer(data[: len(data) // kind.itemsize * kind.itemsize], kind).copy()


def store(message, points):
    message.data = np.frombuffer(points.tobytes(), np.uint8)
    message.point_step = points.itemsize
    message.width, message.row_step = len(points), points.nbytes


def cloud_values(message, random, now_ns):
    points = cloud_array(message)
    for name in random.permutation(["x", "y", "confidence"])[: random.integers(1, 4)]:
        places = some(random, len(points))
        points[name][places] = [odd(random) for _ in places]
    store(message, points)


def cloud_coordinate(message, random, now_ns):
    points = cloud_array(message)
    xy = np.column_stack([points["x"], points["y"]])
    one_coordinate(xy, random)
    points["x"], points["y"] = xy.T
    store(message, points)


def cloud_ids(message, random, now_ns):
    points = cloud_array(message)
    name = points.dtype.names[-1 if random.random() < 0.5 else 3]
    places = some(random, len(points))
    points[name][places] = np.array([IDS[random.integers(len(IDS))] for _ in places], np.int64).astype(np.uint32)
    store(message, points)


def cloud_length(message, random, now_ns):
    points = cloud_array(message)
    count = [0, 1, 2, 3, 40, 4096, 4097, 10_000][random.integers(8)]
    store(message, np.resize(points, count) if len(points) else points)


def cloud_sizes(message, random, now_ns):
    for name in random.permutation(["width", "height", "point_step", "row_step"])[: random.integers(1, 3)]:
        setattr(message, str(name), size(random))


def cloud_data(message, random, now_ns):
    data = bytes(message.data)
    kind = random.integers(3)
    if kind == 0:
        data = data[: random.integers(0, len(data) + 1)]
    elif kind == 1:
        data = data + bytes(random.integers(1, 5000))
    else:
        data = random.bytes(len(data))
    message.data = np.frombuffer(data, np.uint8)


def cloud_order(message, random, now_ns):
    message.is_bigendian = not message.is_bigendian


def cloud_fields(message, random, now_ns):
    fields = message.fields
    kind = random.integers(8)
    field = fields[random.integers(len(fields))] if fields else None
    if field is None or kind == 0:
        message.fields = []
    elif kind == 1:
        message.fields = [f for f in fields if f is not field]
    elif kind == 2:
        message.fields = [*fields, field]
    elif kind == 3:
        message.fields = fields * 20
    elif kind == 4:
        field.name = ["x", "id", "person", "u", "Z" * 10_000, ""][random.integers(6)]
    elif kind == 5:
        field.datatype = int(random.integers(256))
    elif kind == 6:
        field.offset = size(random)
    else:
        field.count = size(random)


def depths(random, count):
    """Depths, m: near a person or anywhere, some of them odd."""
    values = random.uniform(2.0, 5.0) + random.normal(size=count) * 10.0 ** random.uniform(-3, 2)
    places = some(random, count) if random.random() < 0.5 else []
    values[places] = [odd(random) for _ in places]
    return values.astype(np.float32)


def cloud_depth(message, random, now_ns):
    """Add the field `depth`."""
    if not message.fields:
        return
    points = cloud_array(message)
    wider = np.empty(len(points), [*points.dtype.descr, ("depth", "<f4")])
    for name in points.dtype.names:
        wider[name] = points[name]
    wider["depth"] = depths(random, len(points))
    field = deepcopy(message.fields[0])
    field.name, field.offset, field.datatype, field.count = "depth", points.itemsize, 7, 1
    message.fields = [*message.fields, field]
    store(message, wider)


def cloud_types(message, random, now_ns):
    """Other types of numbers for the fields, in either byte order."""
    points = cloud_array(message)
    if [field.name for field in message.fields] != list(points.dtype.names):
        return
    codes, order = {1: "i1", 4: "u2", 5: "i4", 7: "f4", 8: "f8", 9: "i8", 10: "u8"}, "<>"[random.integers(2)]
    kinds = random.choice(list(codes), len(points.dtype.names)).tolist()
    other = np.dtype([(name, order + codes[kind]) for name, kind in zip(points.dtype.names, kinds)])
    with np.errstate(invalid="ignore", over="ignore"):
        message.data = np.frombuffer(points.astype(other).tobytes(), np.uint8)
    message.fields = [deepcopy(field) for field in message.fields]
    for field, kind in zip(message.fields, kinds):
        field.offset, field.datatype = other.fields[field.name][1], kind
    message.point_step, message.is_bigendian = other.itemsize, order == ">"
    message.row_step = message.point_step * message.width


def rescaled(xy, random, size=(640, 480)):
    """Pixels (k, 2) as those of an image of another size, as percent or as fractions of it."""
    factors = [[0.5, 0.5], [2, 2], [1.37, 1.37], 100 / np.array(size), 1 / np.array(size), [1, -1]]
    return xy * factors[random.integers(len(factors))]


def cloud_scale(message, random, now_ns):
    points = cloud_array(message)
    if len(points):
        with np.errstate(over="ignore", invalid="ignore"):  # other damage may have made the numbers huge
            points["x"], points["y"] = rescaled(np.column_stack([points["x"], points["y"]]), random).T
        store(message, points)


# PolygonStamped, Float32MultiArray


def polygon_values(message, random, now_ns):
    for place in some(random, len(message.polygon.points)):
        setattr(message.polygon.points[place], "xyz"[random.integers(3)], odd(random))


def polygon_coordinate(message, random, now_ns):
    axis, value = "xy"[random.integers(2)], PLACES[random.integers(len(PLACES))]
    for place in some(random, len(message.polygon.points)):
        setattr(message.polygon.points[place], axis, value)


def polygon_length(message, random, now_ns):
    points = message.polygon.points
    message.polygon.points = (points * 600)[: [0, 1, 3, 16, 18, 4097, 10_000][random.integers(7)]]


def array_values(message, random, now_ns):
    data = np.array(message.data)
    places = some(random, len(data))
    data[places] = [odd(random) for _ in places]
    message.data = data


def array_coordinate(message, random, now_ns):
    data = np.array(message.data)
    rows = data[: len(data) // 3 * 3].reshape(-1, 3)
    one_coordinate(rows[:, :2], random)
    message.data = data


def array_length(message, random, now_ns):
    message.data = np.resize(message.data, [0, 1, 2, 3, 50, 52, 54, 12_289, 30_000][random.integers(9)])


def array_order(message, random, now_ns):
    """All x, then all y, then all confidences; or pixels of another image, percent, fractions."""
    rows = np.array(message.data)[: len(message.data) // 3 * 3].reshape(-1, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        rows[:, :2] = rescaled(rows[:, :2], random)
    message.data = (rows.T if random.random() < 0.5 else rows).ravel()


def array_offset(message, random, now_ns):
    message.layout.data_offset = size(random)


# hri, yolo, zed


def hri_values(message, random, now_ns):
    for place in some(random, len(message.skeleton)):
        setattr(message.skeleton[place], "xyc"[random.integers(3)], odd(random))


def yolo_values(message, random, now_ns):
    for detection in message.detections:
        for place in some(random, len(detection.keypoints.data)):
            point = detection.keypoints.data[place]
            kind = random.integers(4)
            if kind == 0:
                point.id = IDS[random.integers(len(IDS))]
            elif kind == 1:
                point.score = odd(random)
            else:
                setattr(point.point, "xy"[kind - 2], [odd(random), 1e300][random.integers(2)])


def yolo_coordinate(message, random, now_ns):
    axis, value = "xy"[random.integers(2)], PLACES[random.integers(len(PLACES))]
    for detection in message.detections:
        for place in some(random, len(detection.keypoints.data)):
            setattr(detection.keypoints.data[place].point, axis, value)


def yolo_lists(message, random, now_ns):
    kind = random.integers(4)
    if kind == 0:
        message.detections = []
    elif kind == 1:
        message.detections = (message.detections * int(random.integers(2, 130)))[:150]
    else:
        longest = [0, 1, 3, 10_000][random.integers(4)] // max(1, len(message.detections))
        for detection in message.detections:
            points = detection.keypoints.data
            detection.keypoints.data = (points * 600)[:longest]


def yolo_ids(message, random, now_ns):
    for detection in message.detections:
        detection.id = ["", "1", "-1", "1" * 18, "1" * 19, "²", "0x1", "7\x00", "9" * 10_000][random.integers(9)]


def yolo_depth(message, random, now_ns):
    """Fill keypoints3d."""
    make = backend().make
    for detection in message.detections:
        detection.keypoints3d.frame_id = message.header.frame_id if random.random() < 0.8 else text(random)
        detection.keypoints3d.data = []
        points = detection.keypoints.data
        for place, z in zip(some(random, len(points)), depths(random, len(points)).tolist()):
            point = make("yolo_msgs/msg/KeyPoint3D")
            point.id, point.point.z = points[place].id if random.random() < 0.9 else IDS[random.integers(len(IDS))], z
            detection.keypoints3d.data.append(point)


def zed_depth(message, random, now_ns):
    """Fill the 3D skeleton."""
    for body in message.objects:
        for point, x in zip(body.skeleton_3d.keypoints, depths(random, 70).tolist()):
            point.kp = np.array([x, odd(random), odd(random)], np.float32)


def zed_scale(message, random, now_ns):
    """3D skeletons whose projections are the keypoints, of an image of another size."""
    for body in message.objects:
        xy = np.array([point.kp for point in body.skeleton_2d.keypoints])
        with np.errstate(over="ignore", invalid="ignore"):
            rays = (rescaled(xy, random) - [320, 240]) / 600.0
        for point, (x, y) in zip(body.skeleton_3d.keypoints, rays):
            point.kp = np.array([3.0, -3 * x, -3 * y], np.float32)


def zed_values(message, random, now_ns):
    for body in message.objects:
        for place in some(random, 70):
            body.skeleton_2d.keypoints[place].kp = np.array([odd(random), odd(random)], np.float32)


def zed_scalars(message, random, now_ns):
    for body in message.objects:
        kind = random.integers(6)
        if kind == 0:
            body.confidence = odd(random)
        elif kind == 1:
            body.body_format = int(random.integers(-128, 128))
        elif kind == 2:
            body.label_id = int(random.integers(-(2**15), 2**15))
        elif kind == 3:
            body.tracking_state = int(random.integers(-128, 128))
        elif kind == 4:
            body.tracking_available = body.skeleton_available = bool(random.integers(2))
        else:
            body.skeleton_keypoint_confidence = np.array([odd(random) for _ in range(70)], np.float32)


def zed_lists(message, random, now_ns):
    message.objects = (message.objects * [0, 2, 60, 130][random.integers(4)])[:130]


# camera_info


def camera_matrices(message, random, now_ns):
    for name in random.permutation(["k", "p", "r"])[: random.integers(1, 3)]:
        values = np.array(getattr(message, str(name)))
        places = some(random, len(values)) if random.random() < 0.3 else random.integers(len(values), size=1)
        values[places] = [[odd(random), -600.0, 1e8, 1e-12][random.integers(4)] for _ in places]
        setattr(message, str(name), values)


def camera_distortion(message, random, now_ns):
    models = ["plumb_bob", "rational_polynomial", "equidistant", "fisheye", "", "omni", "x" * 10_000]
    message.distortion_model = models[random.integers(len(models))]
    count = [0, 1, 4, 5, 8, 12, 14, 15, 33, 5000][random.integers(10)]
    scale = [0.0, 0.1, 10.0, 1e6, 1e30, 1e300][random.integers(6)]
    message.d = random.normal(size=count) * scale
    if random.random() < 0.3 and count:
        message.d[random.integers(count)] = odd(random)


def camera_sizes(message, random, now_ns):
    message.width, message.height = size(random), size(random)


def camera_window(message, random, now_ns):
    if random.random() < 0.5:
        message.binning_x, message.binning_y = size(random), size(random)
    roi = message.roi
    for name in random.permutation(["x_offset", "y_offset", "width", "height"])[: random.integers(0, 4)]:
        setattr(roi, str(name), size(random))


HEADER = {"stamp": stamp, "frame_id": frame_id}
WAYS = {
    "sensor_msgs/msg/PointCloud2": {
        "values": cloud_values,
        "one coordinate": cloud_coordinate,
        "ids": cloud_ids,
        "length": cloud_length,
        "sizes": cloud_sizes,
        "data": cloud_data,
        "byte order": cloud_order,
        "fields": cloud_fields,
        "types": cloud_types,
        "scale": cloud_scale,
        "depth": cloud_depth,
        **HEADER,
    },
    "geometry_msgs/msg/PolygonStamped": {
        "values": polygon_values,
        "one coordinate": polygon_coordinate,
        "length": polygon_length,
        **HEADER,
    },
    "std_msgs/msg/Float32MultiArray": {
        "values": array_values,
        "one coordinate": array_coordinate,
        "length": array_length,
        "offset": array_offset,
        "order": array_order,
    },
    "std_msgs/msg/Float64MultiArray": {
        "values": array_values,
        "length": array_length,
        "offset": array_offset,
        "order": array_order,
    },
    "hri_msgs/msg/Skeleton2D": {"values": hri_values, **HEADER},
    "yolo_msgs/msg/DetectionArray": {
        "values": yolo_values,
        "one coordinate": yolo_coordinate,
        "lists": yolo_lists,
        "ids": yolo_ids,
        "depth": yolo_depth,
        **HEADER,
    },
    "zed_msgs/msg/ObjectsStamped": {
        "values": zed_values,
        "scalars": zed_scalars,
        "lists": zed_lists,
        "depth": zed_depth,
        "scale": zed_scale,
        **HEADER,
    },
    "sensor_msgs/msg/CameraInfo": {
        "matrices": camera_matrices,
        "distortion": camera_distortion,
        "sizes": camera_sizes,
        "window": camera_window,
        **HEADER,
    },
}
"""Message type -> kind of damage -> function(message, random, now_ns)."""


def spoil(message_type, message, ways, seed, now_ns):
    """Apply some kinds of damage, in this order."""
    random = np.random.default_rng(seed)
    for way in ways:
        WAYS[message_type][way](message, random, now_ns)
    return message
