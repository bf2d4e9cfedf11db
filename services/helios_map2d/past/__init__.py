"""Views of the past, kept so that a question that comes later can be asked of them."""
