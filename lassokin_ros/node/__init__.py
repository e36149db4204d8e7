"""The ROS 2 node. `inputs` contains its subscriptions."""
