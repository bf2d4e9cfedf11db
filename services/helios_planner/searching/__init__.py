"""Finding a thing or a receptacle: global search, local search, extra views (section 3.2)."""
