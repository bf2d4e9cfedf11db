"""What is said of a thing: scores, what-ifs and figures (eq. 6, 7, 11 and 12)."""
