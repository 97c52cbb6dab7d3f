"""Code blocks and commands of the documentation, and a way to run the commands as printed."""

import os
import pathlib
import re
import shlex
import subprocess
import sys
import textwrap
from typing import NamedTuple

from conftest import BINARY

ROOT = pathlib.Path(__file__).parents[2]
#: Address of the server in the documentation.
URL = "http://127.0.0.1:8700"
#: Programs whose commands must run as printed.
PROGRAMS = ("python", "python3", "pip", "torchrun")
#: Fenced block: its language and its text.
FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
#: Prompt before a printed command; a host can have its own, as `head$`.
PROMPT = re.compile(r"^\w*\$ +")
#: Comment at the end of a printed command.
COMMENT = re.compile(r"\s+# .*")


class Block(NamedTuple):
    """Fenced block of a page."""

    #: Language after the fence, empty if there is none.
    language: str
    text: str


def pages():
    """Returns the paths of all pages for users and contributors, relative to the repository."""
    files = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("python/*.md"), *ROOT.glob("python/*/*.md")]
    return sorted(str(file.relative_to(ROOT)) for file in files if file.name != "CHANGELOG.md")


def read_page(page):
    """Returns the text of a page."""
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page):
    """Returns the fenced blocks of a page."""
    return [Block(language, textwrap.dedent(text)) for language, text in FENCE.findall(read_page(page))]


def code_blocks(page):
    """Returns the Python blocks of a page."""
    return [block.text for block in blocks(page) if block.language in ("python", "py")]


def commands(page):
    """Returns the commands of Python programs that a page prints, in blocks and in inline code, without prompts and comments."""
    lines = []
    for block in blocks(page):
        if block.language in ("", "sh", "bash", "shell", "console", "text"):
            lines += re.sub(r"\\\n\s*", "", block.text).splitlines()
    prose = FENCE.sub("", read_page(page))
    lines += [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", prose)]
    stripped = (COMMENT.sub("", PROMPT.sub("", line)).strip() for line in lines)
    return [line for line in stripped if line.split(" ")[0] in PROGRAMS and " " in line]


def printed_output(page, command):
    """Returns the lines that a page prints below a command, up to the next command or the end of the block."""
    text = next(block.text for block in blocks(page) if f"$ {command}\n" in block.text)
    lines = text.split(f"$ {command}\n", 1)[1].splitlines()
    ends = [number for number, line in enumerate(lines) if PROMPT.match(line)]
    return lines[: ends[0] if ends else None]


def replace_all(text, replacements):
    """Replaces parts of printed text, each of which must occur in it."""
    for old, new in replacements.items():
        assert old in text, f"{old!r} is not in {text!r}"
        text = text.replace(old, new)
    return text


def printed_command(page, start, replacements=None):
    """Returns the only command of a page that starts with `start`, with replaced parts."""
    (command,) = [command for command in commands(page) if command.startswith(start)]
    return replace_all(command, replacements or {})


def run_command(command, folder, *more, python=sys.executable, timeout=600):
    """Runs a printed Python command in a folder that has the examples; returns its standard output.

    Args:
        command: Command that starts with `python`.
        folder: Empty folder, in which the command runs.
        more: Words to append to the command.
        python: Interpreter to run it with.
        timeout: Maximum duration, seconds.
    """
    examples = folder / "examples"
    if not examples.exists():
        examples.symlink_to(ROOT / "examples")
    program, *words = shlex.split(command)
    assert program == "python"
    path = os.pathsep.join([os.fspath(ROOT / "python"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "SPARRING_BIN": BINARY or "", "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    ended = subprocess.run([python, *words, *more], cwd=folder, env=environment, capture_output=True, text=True, timeout=timeout)
    assert ended.returncode == 0, f"{command}\n{ended.stdout}{ended.stderr[-3000:]}"
    return ended.stdout
