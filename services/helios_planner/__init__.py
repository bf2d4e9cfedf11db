"""Planner: from an instruction to actions (paper section 3.2 and appendix 6.1)."""
