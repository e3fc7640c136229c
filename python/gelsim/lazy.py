"""Attributes that are made when they are first read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, Union, overload

T = TypeVar("T")


class lazy(Generic[T]):
    """An attribute that is made when it is first read, and stays: the same object for all threads.

    `functools.cached_property` without its lock. Before Python 3.12 all objects of a class share that: what is made without the GIL
    keeps the threads of all others waiting, and a process that is forked meanwhile waits for ever.
    """

    def __init__(self, make: Callable[[Any], T]) -> None:
        self.make, self.__doc__ = make, make.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> lazy[T]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: Any, owner: type) -> Union[lazy[T], T]:
        if instance is None:
            return self
        # Without __set__ Python looks here only until the object itself has it. Of threads that make it at once one is first.
        found: T = instance.__dict__.setdefault(self.name, self.make(instance))
        return found
