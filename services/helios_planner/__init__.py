"""Planner: runs instructions as robot actions (paper section 3.2 and appendix 6.1)."""
