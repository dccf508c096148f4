"""Files in and out: scene files, tables, histories, pictures, series for ParaView."""
