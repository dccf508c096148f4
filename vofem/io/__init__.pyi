from .movies import animate as animate
from .space import show as show
from .space import snapshot as snapshot
