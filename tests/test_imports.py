import subprocess
import sys

import grimp
import networkx
import pytest

HEAVY = ("pytorch_lightning", "hydra", "omegaconf", "mlflow", "rich", "torchvision", "matplotlib")


def packages_of(name):
    """Those that are imported before a module is."""
    parts = name.split(".")
    return {".".join(parts[:length]) for length in range(1, len(parts))}


def test_no_module_imports_itself_through_others_or_through_their_packages():
    """So each can be imported first: importing a module runs the ``__init__`` of its packages, which import others."""
    graph = grimp.build_graph("sextant", cache_dir=None)
    edges = [
        (name, run)
        for name in graph.modules
        for other in graph.find_modules_directly_imported_by(name)
        for run in {other, *(packages_of(other) - packages_of(name) - {name})}
    ]
    circles = [circle for circle in networkx.strongly_connected_components(networkx.DiGraph(edges)) if len(circle) > 1]
    assert circles == []


@pytest.mark.slow
def test_applications_need_neither_hydra_nor_lightning_nor_mlflow():
    program = f"""
import importlib, pkgutil, sys
for name in ("sextant.applications", "sextant.trained"):
    for module in pkgutil.walk_packages(importlib.import_module(name).__path__, name + "."):
        importlib.import_module(module.name)
print([name for name in {HEAVY} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
