"""Driving, turning and looking over known ground, with the recoveries that moving needs."""
