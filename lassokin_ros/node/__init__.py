"""The ROS 2 node. Only this package and the nodes `camera` and `detector` import rclpy.

`camera_info_input` is the subscription of camera_info; `latched_camera_info` requests a message that was published
before the node started. Both only receive messages: `msg_adapters.camera_info` checks their content, and
`pipeline.camera` finds the camera of each image.
"""
