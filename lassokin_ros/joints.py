"""Indices of the skeleton's joints in `~/joints`, `~/skeleton` and `~/joint_uncertainty`.

    from lassokin_ros.joints import LEFT_WRIST, NAMES

    wrist = pose_array.poses[LEFT_WRIST].position
    assert NAMES[LEFT_WRIST] == "left_wrist"

This is SMPL's order, which the built-in skeleton has. Other skeletons have the order of their own file. The module
imports nothing.
"""

PELVIS = 0
LEFT_HIP = 1
RIGHT_HIP = 2
SPINE1 = 3
LEFT_KNEE = 4
RIGHT_KNEE = 5
SPINE2 = 6
LEFT_ANKLE = 7
RIGHT_ANKLE = 8
SPINE3 = 9
LEFT_FOOT = 10
RIGHT_FOOT = 11
NECK = 12
LEFT_COLLAR = 13
RIGHT_COLLAR = 14
HEAD = 15
LEFT_SHOULDER = 16
RIGHT_SHOULDER = 17
LEFT_ELBOW = 18
RIGHT_ELBOW = 19
LEFT_WRIST = 20
RIGHT_WRIST = 21
LEFT_HAND = 22
RIGHT_HAND = 23

INDEX = {name.lower(): value for name, value in dict(globals()).items() if name.isupper()}
"""Index of each joint by its name: INDEX["left_wrist"] == LEFT_WRIST == 20."""
NAMES = tuple(INDEX)
"""Name of each joint: NAMES[20] == "left_wrist"."""
