"""ROS 2: a driver for any ROS 2 robot, and HELIOS' maps and tasks as ROS topics.

See docs/tutorials/your-ros2-robot.md. Only the processes that use ROS import `rclpy`.
"""
