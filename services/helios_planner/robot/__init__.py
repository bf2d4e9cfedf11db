"""Interface to the robot and its maps, and its implementation over the bus."""
