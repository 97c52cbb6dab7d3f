"""Writes the methods of the client from the OpenAPI document: python3 scripts/python-client.py openapi.json"""

import json
import keyword
import sys
import textwrap

HEAD = '''"""The operations of a server's API, to wait for and to await. Written by scripts/python-client: do not edit."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import Any, Literal, Protocol
from urllib.parse import quote

from typing_extensions import Unpack

from . import types


class Asks(Protocol):
    """Who asks the server, and waits for its answer."""

    def __call__(self, method: str, path: str, query: dict[str, Any], body: Any, *, again: bool) -> Any: ...


class AsksLater(Protocol):
    """The same, to be awaited."""

    def __call__(self, method: str, path: str, query: dict[str, Any], body: Any, *, again: bool) -> Awaitable[Any]: ...
'''

#: What does something else when it is asked a second time.
ONCE = {"create", "take", "ask", "begin"}
#: A socket and a stream are not one answer to one question.
ELSEWHERE = {"connect", "listen"}


def plain(value):
    """A query parameter's type."""
    if "enum" in value:
        return f"Literal[{', '.join(map(repr, value['enum']))}]"
    kind = value.get("type")
    kinds = kind if isinstance(kind, list) else [kind]
    names = {"string": "str", "integer": "int", "number": "float", "boolean": "bool"}
    return next((names[kind] for kind in kinds if kind in names), "str")


def called(operation, tag):
    """What a method is called in the group of its tag."""
    name = operation["operationId"]
    for end in (f"_{tag}", f"_{tag.removesuffix('s')}", "_list" if name == "list_list" else "_"):
        name = name.removesuffix(end)
    return name


def method(verb, path, operation, tag, later):
    """One method."""
    parameters = [one for one in operation.get("parameters", []) if one["in"] in ("path", "query")]
    inside = [one["name"] for one in parameters if one["in"] == "path"]
    query = [one for one in parameters if one["in"] == "query"]
    body = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {}).get("$ref")
    answer = next(answer for code, answer in operation["responses"].items() if code.startswith("2"))
    answer = answer["content"]["application/json"]["schema"]["$ref"].rsplit("/", 1)[1]
    safe = {one["name"]: one["name"] + "_" * keyword.iskeyword(one["name"]) for one in query}
    told = [f"{name}: str" for name in inside]
    if query:
        needed = [f"{safe[one['name']]}: {plain(one['schema'])}" for one in query if one.get("required")]
        free = [f"{safe[one['name']]}: {plain(one['schema'])} | None = None" for one in query if not one.get("required")]
        told += ["*", *needed, *free]
    if body:
        told.append(f"**body: Unpack[types.{body.rsplit('/', 1)[1]}]")
    where = path.replace("{", "{_part(").replace("}", ")}") if inside else path
    lines = textwrap.wrap(" ".join(operation["summary"].split()), 116)
    told_of = [one for one in query if one.get("description")]
    if told_of:
        lines += ["", "Args:"]
        for one in told_of:
            text = f"{safe[one['name']]}: {' '.join(one['description'].split())}"
            lines += textwrap.wrap(text, 112, initial_indent="    ", subsequent_indent="        ")
    doc = "\n        ".join(line for line in ['"""' + lines[0], *lines[1:]])
    doc = doc + ('\n        """' if len(lines) > 1 else '"""')
    doc = "\n".join(line.rstrip() for line in doc.split("\n"))
    question = f"{verb.upper()!r}, {'f' if inside else ''}{where!r}"
    queries = ", ".join(f"{one['name']!r}: {safe[one['name']]}" for one in query)
    again = operation["operationId"] not in ONCE
    call = f"self._ask({question}, {{{queries}}}, {'body' if body else None}, again={again})"
    answered = "await " if later else ""
    return f'''
    {"async " if later else ""}def {called(operation, tag)}(self, {", ".join(told)}) -> types.{answer}:
        {doc}
        answer: types.{answer} = {answered}{call}
        return answer
'''.replace("(self, )", "(self)")


def groups(document):
    """Operations of /v1 by their tags."""
    found = {}
    for path, verbs in document["paths"].items():
        for verb, operation in verbs.items():
            if path.startswith("/v1/") and operation["operationId"] not in ELSEWHERE:
                found.setdefault(operation["tags"][0], []).append((verb, path, operation))
    return dict(sorted(found.items()))


def main():
    with open(sys.argv[1]) as file:
        document = json.load(file)
    found = groups(document)
    about = {tag["name"]: tag.get("description", "") for tag in document.get("tags", [])}
    print(HEAD)
    print("""
def _part(text: str) -> str:
    # An id is never more than one part of a path, whatever is in it.
    return quote(text, safe="")
""".rstrip())
    for later in (False, True):
        for tag, operations in found.items():
            name = ("Async" if later else "") + tag.capitalize()
            print(f'\n\nclass {name}:\n    """{about.get(tag) or tag.capitalize()}"""\n')
            print(f"    def __init__(self, ask: {'AsksLater' if later else 'Asks'}) -> None:\n        self._ask = ask")
            for verb, path, operation in operations:
                print(method(verb, path, operation, tag, later), end="")
        name = "AsyncOperations" if later else "Operations"
        print(f'\n\nclass {name}:\n    """All of /v1, by what it is about."""\n')
        print(f"    def _begin(self, ask: {'AsksLater' if later else 'Asks'}) -> None:")
        for tag in found:
            print(f"        self.{tag} = {'Async' if later else ''}{tag.capitalize()}(ask)")


main()
