"""The base of every error a user of swarmstart can cause.

Each folder derives its own classes in the module that raises them; each carries, as
attributes, the data a program needs to react, and a message that says what was
expected, what was found and where.
"""

import importlib
import pickle
from collections.abc import Callable
from typing import Any

LONGEST_SHOWN = 200
"""Characters of a value in a message."""


class Sendable:
    """Base of exceptions that are pickled with their message and all attributes.

    By default Python would make them again from the message alone; the constructor then
    fails, and ends the process that waits for the exception. An attribute that cannot
    be pickled becomes its text.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Return how to make the exception again."""
        kept = {name: _sendable(value) for name, value in vars(self).items()}
        return _made_again, (type(self), self.args, kept)  # type: ignore[attr-defined]


def _sendable(value: object) -> object:
    try:
        pickle.dumps(value)
    except Exception:  # noqa: BLE001 - CasADi raises this class itself
        return brief(value)
    return value


def _made_again(
    kind: type[BaseException], args: tuple[object, ...], kept: dict[str, object]
) -> BaseException:
    """Return an exception as it was, without its constructor."""
    error = kind.__new__(kind, *args)
    vars(error).update(kept)
    return error


class SwarmstartError(Sendable, Exception):
    """Base of all errors a caller can cause; the message says what is wrong and why."""


class InvalidArgumentError(SwarmstartError, ValueError):
    """An argument of a call has a type or a value that is not allowed.

    Attributes:
        name: Name of the argument.
        value: The value that was given.
        allowed: What is allowed, in words.
    """

    def __init__(self, name: str, value: object, allowed: str) -> None:
        """Keep the parts of the message."""
        super().__init__(f"{name} must be {allowed}, got {brief(value)}")
        self.name = name
        self.value = value
        self.allowed = allowed


class MissingPackageError(SwarmstartError, ImportError):
    """An optional package is not installed; the message says how to install it."""


def load_optional(module: str, *, extra: str, need: str) -> Any:
    """Import an optional module, and return the package that contains it.

    Args:
        module: Full name of the module.
        extra: The extra of swarmstart that installs it.
        need: Name of the feature that needs the module; the message begins with it.

    Raises:
        MissingPackageError: If the module is not installed.

    Example:
        >>> load_optional("json.decoder", extra="none", need="nothing").__name__
        'json'
    """
    package = module.partition(".")[0]
    try:
        found = importlib.import_module(package)
        importlib.import_module(module)
    except ImportError as error:
        raise MissingPackageError(
            f"{need} needs {package}, which is not installed: "
            f"pip install 'swarmstart[{extra}]' (in a clone: pip install '.[{extra}]')"
        ) from error
    return found


def brief(value: object) -> str:
    """Return the text of a value for a message, on one line and cut if it is long."""
    # Not the repr of a text of megabytes, of which the message shows the begin only.
    shown = repr(value[:LONGEST_SHOWN] if isinstance(value, str) else value)
    shown = " ".join(shown.split())
    if len(shown) > LONGEST_SHOWN:
        return f"{shown[: LONGEST_SHOWN - 3]}..."
    return shown
