"""YAML with Python's tuples and numpy's numbers, read without making any other object.

`yaml.dump` writes tuples, numpy scalars and arrays with tags that name functions. The authors
of the paper read them with a loader that calls them. Here only numbers are taken from
them; every other tag is refused.
"""

from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

PYTHON = "tag:yaml.org,2002:python/"
NUMPY_PARTS = ("core.multiarray.", "_core.multiarray.")
"""Modules of numpy, of its versions 1 and 2, that tags of numbers name."""
KINDS = {f"{kind}{size}" for kind in "iu" for size in (1, 2, 4, 8)} | {"f2", "f4", "f8", "b1"}
"""Types of numpy's numbers that are read."""


class NumberLoader(yaml.SafeLoader):
    """Loads plain YAML, tuples as lists, and numpy's numbers and arrays as numbers and lists."""


def _apply(loader: NumberLoader, suffix: str, node: yaml.Node) -> Any:
    """Return what a call of numpy's would give, for the calls that give numbers or their types."""
    name = suffix
    for part in NUMPY_PARTS:
        name = name.removeprefix(part)
    if name not in ("dtype", "scalar", "_reconstruct"):
        raise yaml.constructor.ConstructorError(
            None, None, f"numpy.{suffix} is not a number", node.start_mark
        )
    arguments, state = _call(loader, node)
    try:
        if name == "dtype":
            return _dtype(arguments, state)
        if name == "scalar":
            return np.frombuffer(arguments[1], arguments[0])[0].item()
        _, shape, kind, by_column, content = state
        order: Any = "F" if by_column else "C"
        found: NDArray[Any] = np.frombuffer(content, kind).reshape(shape, order=order)
    except (IndexError, KeyError, TypeError, ValueError) as error:
        raise yaml.constructor.ConstructorError(
            None, None, f"numpy.{suffix} has other values than a number has", node.start_mark
        ) from error
    return found.tolist()


def _call(loader: NumberLoader, node: yaml.Node) -> tuple[Any, Any]:
    """Return arguments and state of a call that a tag describes."""
    if isinstance(node, yaml.MappingNode):
        content: dict[Any, Any] = loader.construct_mapping(node, deep=True)
        return content.get("args", []), content.get("state")
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True), None
    raise yaml.constructor.ConstructorError(None, None, "a call has arguments", node.start_mark)


def _dtype(arguments: Any, state: Any) -> np.dtype[Any]:
    """Return a type of numbers, in the byte order of its state."""
    name = str(arguments[0])
    if name not in KINDS:
        raise ValueError(f"{name} is no type of numbers")
    order: Any = state[1] if state else "="
    return np.dtype(name).newbyteorder("=" if order == "|" else order)


def _tuple(loader: NumberLoader, node: yaml.Node) -> list[Any]:
    if not isinstance(node, yaml.SequenceNode):
        raise yaml.constructor.ConstructorError(None, None, "a tuple is a list", node.start_mark)
    return loader.construct_sequence(node, deep=True)


def _text(loader: NumberLoader, node: yaml.Node) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise yaml.constructor.ConstructorError(None, None, "a text is a scalar", node.start_mark)
    return str(loader.construct_scalar(node))


def _array_type(loader: NumberLoader, suffix: str, node: yaml.Node) -> None:  # noqa: ARG001
    """Return nothing for the name of the type of arrays, and refuse other names."""
    if suffix != "numpy.ndarray":
        raise yaml.constructor.ConstructorError(
            None, None, f"{suffix} is not a number", node.start_mark
        )


NumberLoader.add_constructor(f"{PYTHON}tuple", _tuple)
NumberLoader.add_constructor(f"{PYTHON}unicode", _text)
NumberLoader.add_constructor(f"{PYTHON}str", _text)
NumberLoader.add_multi_constructor(f"{PYTHON}object/apply:numpy.", _apply)
NumberLoader.add_multi_constructor(f"{PYTHON}name:", _array_type)


def load_numbers(text: str) -> Any:
    """Read YAML with tags of Python's tuples and numpy's numbers.

    Raises:
        yaml.YAMLError: the text is no YAML, or has tags of anything else.
    """
    return yaml.load(text, Loader=NumberLoader)  # noqa: S506
