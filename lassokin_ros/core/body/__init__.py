"""The body: skeleton and the roles of its joints, kinematics, rotations, joint angles, surface, landmark layouts,
proportions, symmetry.
"""
