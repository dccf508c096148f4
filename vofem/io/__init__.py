"""What a user looks at and keeps: pictures, movies, tables, files of scenes and of runs.

`animate` writes movies, `show` opens a window, `snapshot` draws the structure in three dimensions. `plot`, `render`,
`vtk`, `csv_file` and `doctor` are modules of this package.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
