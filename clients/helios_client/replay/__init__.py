"""`helios replay`: a recording or data set through the services, and what they made of it."""
