"""Files in and out: pictures. Nothing here is imported by the rest of vofem."""
