"""Tasks for any of several robots: their queue, and the choice of the robot."""
