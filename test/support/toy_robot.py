"""A humanoid of boxes without shapes: its URDF and its file, for tests that need no robot of others."""

from lassokin_ros.robot.robot_file import RobotFile

SIDES = (("left", 1), ("right", -1))
LINKS = {"base": "pelvis", "torso": "chest"}
ARM = (  # joint, axis, place in the parent (y of the left side), limits
    ("shoulder_pitch", "0 1 0", (0.0, 0.15, 0.25), (-3.0, 1.5)),
    ("shoulder_roll", "1 0 0", (0.0, 0.05, 0.0), (-0.5, 2.5)),
    ("shoulder_yaw", "0 0 1", (0.0, 0.0, -0.05), (-2.0, 2.0)),
    ("elbow", "0 1 0", (0.0, 0.0, -0.2), (-2.4, 0.0)),
)
LEG = (
    ("hip_yaw", "0 0 1", (0.0, 0.1, -0.1), (-1.0, 1.0)),
    ("hip_roll", "1 0 0", (0.0, 0.0, 0.0), (-1.0, 1.0)),
    ("hip_pitch", "0 1 0", (0.0, 0.0, 0.0), (-2.0, 1.0)),
    ("knee", "0 1 0", (0.0, 0.0, -0.35), (0.0, 2.4)),
    ("ankle_pitch", "0 1 0", (0.0, 0.0, -0.35), (-0.9, 0.6)),
    ("ankle_roll", "1 0 0", (0.0, 0.0, 0.0), (-0.4, 0.4)),
)


def _joint(name, parent, place, axis="", limits=(), kind="revolute", more=""):
    x, y, z = place
    turn = (
        f'<axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}" effort="9" velocity="8"/>' if axis else ""
    )
    return (
        f'<link name="{name}_link"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}_link"/><origin xyz="{x} {y} {z}"/>{turn}{more}</joint>'
    )


def urdf(**changed):
    """The URDF. changed: the text of a joint by its name, in place of its own."""
    parts = [
        '<robot name="toy"><link name="pelvis"><visual><geometry><mesh filename="gone.stl"/></geometry></visual></link>'
    ]
    parts.append(
        '<link name="chest"/><joint name="waist" type="revolute"><parent link="pelvis"/><child link="chest"/>'
        '<origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" velocity="8"/></joint>'
    )
    for side, sign in SIDES:
        for chain, root in ((ARM, "chest"), (LEG, "pelvis")):
            parent = root
            for name, axis, (x, y, z), (low, high) in chain:
                if axis == "1 0 0" and sign < 0 and name.startswith("shoulder"):
                    low, high = -high, -low
                full = f"{side}_{name}"
                parts.append(changed.get(full) or _joint(full, parent, (x, sign * y, z), axis, (low, high)))
                parent = f"{full}_link"
        parts.append(_joint(f"{side}_hand", f"{side}_elbow_link", (0.0, 0.0, -0.2), kind="fixed"))
    return "".join([*parts, "</robot>"])


def robot(**settings):
    """The robot's file."""
    links = dict(LINKS)
    for side, _ in SIDES:
        links |= {
            f"{side}_{place}": f"{side}_{link}_link"
            for place, link in (
                *(("shoulder", "shoulder_roll"), ("elbow", "elbow"), ("wrist", "hand")),
                *(("hip", "hip_pitch"), ("knee", "knee"), ("ankle", "ankle_roll")),
            )
        }
    rest = {f"{side}_{name}": value for side, _ in SIDES for name, value in (("elbow", -0.3), ("knee", 0.2))}
    return RobotFile("toy", links, **{"rest": rest, "sole": 0.05, **settings})


def as_yaml(file):
    """The text of a robot's file."""
    lines = [f"{place}: {link}" for place, link in file.links.items()]
    return "\n".join([*lines, f"rest: {dict(file.rest)}", f"sole: {file.sole}"]) + "\n"
