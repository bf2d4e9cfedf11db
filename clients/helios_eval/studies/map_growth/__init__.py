"""How the object map grows: cost per update, long runs, objects only against the full scene."""
