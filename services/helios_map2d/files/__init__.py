"""Maps as files: kept from crashes, saved, loaded, written for other programs."""
