"""From a keypoint message to an estimate and output messages. Shared by node and replay; needs no rclpy."""
