"""Files in and out: pictures, series for ParaView. Nothing here is imported by the rest of vofem."""
