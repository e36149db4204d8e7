"""Readers of skeletons in other file formats: SMPL model, BVH, URDF.

The core reads YAML only. The readers return the `Skeleton` that `core.tracker.Tracker` takes.
"""
