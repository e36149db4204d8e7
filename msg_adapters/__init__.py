"""Convert messages to arrays and back, for message objects of rclpy and of rosbags. Contains no algorithm."""
