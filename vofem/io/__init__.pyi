from .interactive import show as show
from .movies.animate import animate as animate
from .off_screen import snapshot as snapshot
