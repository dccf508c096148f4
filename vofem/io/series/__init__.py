"""Implementation of series for ParaView: grids, fields and VTU files."""
