"""What is kept: arrays with one row a Gaussian, where the rows are, and the views that counted."""
