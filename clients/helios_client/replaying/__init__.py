"""`helios replay`: a data set through the services, and what came of it."""
