"""A hash of the code that decides what happens in an episode: results are valid for it alone.

Comments, docstrings and layout do not count.
"""

import ast
import hashlib
from pathlib import Path

ROOT = Path(__file__).parent
SHARED = (
    "contract.py",
    "episode.py",
    "layout.py",
    "motion.py",
    "panda.py",
    "policies.py",
    "poses.py",
    "script.py",
    "suite.py",
    "task.py",
)


LOOKS = ("cameras.py", "meshes.py", "raster.py", "raster_draw.py", "raster_shade.py")
JUDGES = (
    "amnesiac.py",
    "automaton.py",
    "certificate.py",
    "likeness.py",
    "probe.py",
    "statistics.py",
)
NEITHER = ("__init__.py", "make_panda_meshes.py", "make_panda_spheres.py", "warm.py")


def sources_hash(task: str, *, certified: bool = False) -> str:
    """SHA-256 of a task's file and of everything that all tasks stand on.

    What a certificate stands on includes the renderer and the code that judges.
    """
    left_out = NEITHER if certified else NEITHER + LOOKS
    files = [
        *(ROOT / name for name in SHARED + (JUDGES if certified else ())),
        *sorted((ROOT / "assets").glob("*.py")),
        *sorted(f for f in (ROOT / "bullet").glob("*.py") if f.name not in left_out),
        ROOT / "tasks" / f"{task}.py",
    ]
    digest = hashlib.sha256((ROOT / "bullet" / "panda_spheres.npz").read_bytes())
    if certified:
        digest.update((ROOT / "bullet" / "panda_meshes.npz").read_bytes())
    for file in files:
        digest.update(file.relative_to(ROOT).as_posix().encode())
        digest.update(_meaning(file.read_text()).encode())
    return digest.hexdigest()


def _meaning(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and _documented(node):
            node.body = node.body[1:]
    return ast.dump(tree)


def _documented(node: ast.Module | ast.ClassDef | ast.FunctionDef) -> bool:
    return bool(node.body) and ast.get_docstring(node, clean=False) is not None
