"""Tests that run in an environment with rclpy: see tests/e2e/test_ros2_hand.py."""
