"""Subscriptions of the node: keypoints, camera_info, depth images, TF, simulated time; and missing inputs.

`keypoint_input` is the subscription of keypoints, `scene_inputs` combines all others. `camera_info_input` is the
subscription of camera_info; `latched_camera_info` requests a message that was published before the node started. Both
only receive messages; `pipeline/camera/camera_selection.py` finds the camera of each image.
"""
