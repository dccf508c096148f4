"""What a user looks at and keeps: pictures, movies, tables, files of scenes and of runs.

`animate` writes movies, `show` opens a window, `snapshot` draws the structure in three dimensions. `plot`, `render`,
`vtk`, `csv_file` and `doctor` are modules of this package.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vofem.io.interactive import show
    from vofem.io.movies.animate import animate
    from vofem.io.off_screen import snapshot

__all__ = ["animate", "show", "snapshot"]

#: Functions that are imported when first asked for, by module.
_LATER = {
    "animate": "vofem.io.movies.animate", "show": "vofem.io.interactive", "snapshot": "vofem.io.off_screen"
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'vofem.io' has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(_LATER[name]), name)
    globals()[name] = value
    return value
