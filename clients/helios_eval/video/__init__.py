"""An episode as a video: camera, maps and decisions side by side."""
