"""A hash of the code that decides what happens in an episode: results are valid for it alone.

Comments, docstrings and layout do not count.
"""

import ast
import hashlib
from functools import lru_cache
from pathlib import Path

from hide_tasks.catalogue import file_of

ROOT = Path(__file__).parent
# What plays, and what certifies; a task's own file and all that these import are hashed with them.
PLAYS = ("episode.py", "policies.py", "suite.py")
JUDGES = ("amnesiac.py", "certificate.py")
# Left out, with what they alone import: how things look and how likeness is judged, unless an
# episode's certificate is meant.
LOOKS = ("bullet/cameras.py", "bullet/meshes.py", "bullet/raster.py", "amnesiac.py")
NEITHER = ("catalogue.py", "certificates/__init__.py", "machine.py", "sources.py")


def sources_hash(task: str, *, certified: bool = False) -> str:
    """SHA-256 of a task's file and of every source that its episodes stand on.

    What a certificate stands on includes the renderer and the code that judges.
    """
    digest = hashlib.sha256((ROOT / "bullet" / "panda_spheres.npz").read_bytes())
    if certified:
        digest.update((ROOT / "bullet" / "panda_meshes.npz").read_bytes())
    for file in sources(task, certified=certified):
        digest.update(file.encode())
        digest.update(_meaning(_text(file)).encode())
    return digest.hexdigest()


def sources(task: str, *, certified: bool = False) -> list[str]:
    """The files that decide what happens in a task's episodes, relative to the package."""
    found: set[str] = set()
    left_out = {*NEITHER, *(() if certified else LOOKS)}
    ahead = [file_of(task), *PLAYS, *(JUDGES if certified else ())]
    while ahead:
        file = ahead.pop()
        if file not in found and file not in left_out:
            found.add(file)
            ahead += _imports(_text(file))
    return sorted(found)


@lru_cache(maxsize=512)
def _text(file: str) -> str:
    return (ROOT / file).read_text()


@lru_cache(maxsize=512)
def _imports(source: str) -> tuple[str, ...]:
    """The package's files that a source imports; those of a package before those in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return tuple(sorted(file for name in names for file in _files(name)))


def _files(module: str) -> list[str]:
    package, *path = module.split(".")
    if package != ROOT.name:
        return []
    inside = Path(*path)
    return [
        file.as_posix()
        for file in (inside / "__init__.py", inside.with_suffix(".py") if path else inside)
        if (ROOT / file).is_file()
    ]


@lru_cache(maxsize=512)
def _meaning(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and _documented(node):
            node.body = node.body[1:]
    return ast.dump(tree)


def _documented(node: ast.Module | ast.ClassDef | ast.FunctionDef) -> bool:
    return bool(node.body) and ast.get_docstring(node, clean=False) is not None
