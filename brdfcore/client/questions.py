"""Methods that both kinds of objects have, those that wait and those to be awaited, each written once.

`question` makes an exchange the method of a class that a `Sync` and an `Async` one inherit: called on the first it
returns the result, on the second a coroutine of it, and type checkers see which.

    class Described:
        @question
        def gloss(self) -> Exchange[dict[str, Any]]:
            return exchanges.told(self.id, "gloss")
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Coroutine
from functools import wraps
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, overload

from brdfcore.client.driver import Driver, finished
from brdfcore.client.exchanges import Exchange

P = ParamSpec("P")
M = TypeVar("M")
T = TypeVar("T")
X = TypeVar("X")
Y = TypeVar("Y")
S = TypeVar("S", covariant=True)
A = TypeVar("A", covariant=True)


class Sync:
    """What waits for its answers."""

    _driver: Driver

    def _ask(self, exchange: Exchange[T]) -> T:
        return finished(self._driver.run(exchange))


class Async:
    """What is awaited."""

    _driver: Driver

    async def _ask(self, exchange: Exchange[T]) -> T:
        return await self._driver.run(exchange)


class Asked(Generic[S, A]):
    """A method of type S on what is `Sync`, of type A on what is `Async`."""

    def __init__(self, exchange: Callable[..., Exchange[Any]], results: tuple[str, str] | None = None) -> None:
        self._exchange, self.__doc__ = exchange, exchange.__doc__

        @wraps(exchange)
        def waits(self: Any, /, *given: Any, **named: Any) -> Any:
            return self._ask(exchange(self, *given, **named))

        @wraps(exchange)
        async def awaited(self: Any, /, *given: Any, **named: Any) -> Any:
            return await self._ask(exchange(self, *given, **named))

        said = str(exchange.__annotations__.get("return", "Any")).removeprefix("Exchange[").removesuffix("]")
        for method, result in zip((waits, awaited), results or (said, said)):
            method.__annotations__ = {**exchange.__annotations__, "return": result}
            method.__signature__ = inspect.signature(exchange).replace(return_annotation=result)  # type: ignore[attr-defined]
        self._waits, self._awaited = waits, awaited

    @overload
    def __get__(self, instance: Sync, owner: Any = None) -> S: ...
    @overload
    def __get__(self, instance: Async, owner: Any = None) -> A: ...
    @overload
    def __get__(self, instance: None, owner: Any = None) -> Callable[..., Any]: ...
    def __get__(self, instance: Any, owner: Any = None) -> Any:
        kind = owner if instance is None else type(instance)
        method: Any = (
            self._waits if issubclass(kind, Sync) else self._awaited if issubclass(kind, Async) else self._exchange
        )
        return method if instance is None else method.__get__(instance, kind)


def question(
    exchange: Callable[Concatenate[M, P], Exchange[T]],
) -> Asked[Callable[P, T], Callable[P, Coroutine[Any, Any, T]]]:
    """The exchange as a method of both kinds, with its arguments, its docstring and its result."""
    return Asked(exchange)


def question_for(
    sync: type[X], awaited: type[Y]
) -> Callable[[Callable[Concatenate[M, P], Exchange[Any]]], Asked[Callable[P, X], Callable[P, Coroutine[Any, Any, Y]]]]:
    """`question` of an exchange whose result is of another class for each kind."""
    return lambda exchange: Asked(exchange, (sync.__name__, awaited.__name__))
