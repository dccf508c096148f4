"""Studies: questions that take many runs to answer."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["accuracy"])
