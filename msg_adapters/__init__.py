"""Messages to arrays and back, for rclpy's and for rosbags' message objects alike. Knows no algorithm."""
