"""Errors about arguments: each names the field, its valid values and the value found."""

from __future__ import annotations


def invalid(field: str, requirement: str, value: object) -> ValueError:
    """Returns the error of an invalid argument: "`field` must be <requirement>, got <value>".

    Args:
        field: Name of the argument, or dotted path of a part of it.
        requirement: Description of the valid values.
        value: Value that was found.
    """
    return ValueError(f"`{field}` must be {requirement}, got {value!r}")


def one_of(field: str, choices: tuple[str, ...], value: object) -> ValueError:
    """Returns the error of an argument that is none of `choices`; see `invalid`."""
    return invalid(field, f"one of {', '.join(choices)}", value)
