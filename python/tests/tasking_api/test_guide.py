"""The code of the guide for users of BSK-RL runs, and its table of names is true."""

import importlib
import re
from pathlib import Path

from documents import code_blocks

PAGE = "docs/guides/from-bsk-rl.md"
ROOT = Path(__file__).parents[3]


def test_printed_code_runs(capsys):
    names = {}
    for block in code_blocks(PAGE):
        exec(block, names)
    assert capsys.readouterr().out == "180.0 True\n"
    assert names["observation"].shape == (4,)


def test_modules_of_the_table_exist():
    found = re.findall(r"`from (sparring[\w.]*) import ([\w, ]+)", (ROOT / PAGE).read_text())
    assert len(found) >= 3
    for module, names in found:
        for name in names.split(", "):
            assert hasattr(importlib.import_module(module), name) or importlib.import_module(f"{module}.{name}")
