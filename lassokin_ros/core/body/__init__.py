"""The body: skeleton, kinematics, rotations, joint angles, landmark layouts, proportions."""
