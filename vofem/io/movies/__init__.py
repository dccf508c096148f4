"""Movies: frames of runs, periodic orbits and mode shapes, written as WebP, GIF or mp4."""
