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
    "poses.py",
    "script.py",
    "suite.py",
    "task.py",
)


def sources_hash(task: str) -> str:
    """SHA-256 of a task's file and of everything that all tasks stand on."""
    files = [
        *(ROOT / name for name in SHARED),
        *sorted((ROOT / "assets").glob("*.py")),
        *sorted(f for f in (ROOT / "bullet").glob("*.py") if not f.name.startswith("make_")),
        ROOT / "tasks" / f"{task}.py",
    ]
    digest = hashlib.sha256()
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
