"""Parsing of an instruction into the objects and places of a task."""
