"""Frozen dataclasses with a fast constructor, for messages.

The constructor of a plain frozen dataclass calls ``object.__setattr__`` for every field. The constructor made here
fills the object while its class is a mutable twin with the same slots, and then sets the class to the frozen one.
"""

from dataclasses import MISSING, dataclass, fields
from typing import Any, TypeVar, cast, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def record(plain: type[T]) -> type[T]:
    """``plain`` as a frozen dataclass with slots and keyword-only fields, and an ``__init__`` of half the cost.

    ``fields``, ``replace``, comparison, hash, repr, copies and pickles are those of a dataclass. Raises TypeError
    for fields with a factory or outside the constructor, and for a class with ``__post_init__``.
    """
    cls = dataclass(frozen=True, slots=True, kw_only=True)(plain)
    known = fields(cast(Any, cls))
    if hasattr(cls, "__post_init__") or not all(f.init and f.default_factory is MISSING for f in known):
        raise TypeError(f"{cls.__name__} must have no __post_init__, and plain fields without a factory")
    draft = type(f"{cls.__name__}Draft", (), {"__slots__": cls.__dict__["__slots__"]})
    defaults = {f"_default_{f.name}": f.default for f in known if f.default is not MISSING}
    arguments = [f.name if f.default is MISSING else f"{f.name}=_default_{f.name}" for f in known]
    body = [f"def __init__(self, *, {', '.join(arguments)}):"]
    body += ["    _become(self, '__class__', _Draft)"]
    body += [f"    self.{f.name} = {f.name}" for f in known]
    body += ["    self.__class__ = _Class"]
    scope: dict[str, Any] = {"_become": object.__setattr__, "_Draft": draft, "_Class": cls, **defaults}
    exec("\n".join(body), scope)  # as in the dataclasses module
    made = scope["__init__"]
    made.__qualname__ = f"{cls.__qualname__}.__init__"
    made.__module__ = cls.__module__
    made.__annotations__ = getattr(cls, "__init__").__annotations__  # noqa: B009
    setattr(cls, "__init__", made)  # noqa: B010
    return cls
