"""`helios replay`: play a recording or data set through the services, and collect the results."""
