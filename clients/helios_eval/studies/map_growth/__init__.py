"""Growth of the object map: cost per update, long runs, objects only against the full scene."""
