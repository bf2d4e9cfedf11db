"""The object map over long walks; the command is `helios_eval.studies.object_map_growth`."""
