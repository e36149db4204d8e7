"""Skeletons from other programs' files: SMPL model, BVH, URDF.

The core reads its own YAML alone; here other formats become the `Skeleton` that `core.tracker.Tracker` takes.
"""
