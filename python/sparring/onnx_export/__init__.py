"""Export of policies to ONNX files, which `sparring eval --policy onnx:FILE` and the server run without Python.

Start with `export.py`. `interface.py` has the format of the file. `sources.py`, `source_policy.py` and `sb3_networks.py` read
models, `environments.py` finds the environment of a model, `graph.py` makes the graph, and `verification.py` compares it with
the model.
"""

try:
    import onnx as _onnx
    import torch as _torch
except ImportError as error:
    raise ImportError("sparring.export_onnx needs onnx and torch: pip install 'sparring[onnx]'") from error

from .export import ExportedPolicy, export_onnx

__all__ = ["ExportedPolicy", "export_onnx"]

del _onnx, _torch
