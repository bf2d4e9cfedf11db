"""A ROS 2 robot in a process of its own: `python -m tests.fake_ros2` (needs rclpy)."""
