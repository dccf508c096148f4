"""An extension of griffe: the site shows docstrings and signatures that are made when the package is imported.

Those of declared classes are made of the annotated fields, see `vofem.parameters`; what all pictures share is added to
the docstrings of `vofem.io.plot`, and what all writers share to theirs.
"""

from __future__ import annotations

import importlib
import inspect
from typing import Any

import griffe

from vofem.histories.table import Tabled
from vofem.parameters import declarations, is_declared

_KINDS = {
    inspect.Parameter.KEYWORD_ONLY: griffe.ParameterKind.keyword_only,
    inspect.Parameter.POSITIONAL_OR_KEYWORD: griffe.ParameterKind.positional_or_keyword,
}


class DeclaredClasses(griffe.Extension):
    """Take docstring and signature of declared classes from the classes themselves."""

    def on_function(self, *, func: griffe.Function, **kwargs: Any) -> None:
        """Replace the docstring of a function that draws a picture or writes a file."""
        decorators = " ".join(str(one.value) for one in func.decorators)
        if func.module.path.startswith("vofem.io.") and ("figure" in decorators or "writer" in decorators):
            made = getattr(importlib.import_module(func.module.path), func.name)
            func.docstring = griffe.Docstring(inspect.getdoc(made) or "", parent=func)

    def on_class(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        """Replace them."""
        made = getattr(importlib.import_module(cls.module.path), cls.name, None)
        if isinstance(made, type) and issubclass(made, Tabled):
            cls.docstring = griffe.Docstring(inspect.getdoc(made) or "", parent=cls)
        if not isinstance(made, type) or not is_declared(made):
            return
        cls.docstring = griffe.Docstring(inspect.getdoc(made) or "", parent=cls)
        parameters = [griffe.Parameter("self", kind=griffe.ParameterKind.positional_or_keyword)]
        for name, one in inspect.signature(made.__init__).parameters.items():
            if name != "self":
                given = None if one.default is inspect.Parameter.empty else repr(one.default)
                parameters.append(griffe.Parameter(name, kind=_KINDS[one.kind], default=given))
        cls.set_member("__init__", griffe.Function("__init__", parameters=griffe.Parameters(*parameters)))
        for name in declarations(made):
            # What the table of parameters says already.
            if name in cls.members and cls.members[name].docstring is None:
                cls.del_member(name)
