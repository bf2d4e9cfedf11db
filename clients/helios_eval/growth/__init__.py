"""The object map over long walks; `python -m helios_eval.object_map_growth` is the command."""
