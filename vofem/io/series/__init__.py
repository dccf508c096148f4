"""Series for ParaView from the inside: grids, fields and VTU files."""
